//! Plain tables of numbers, read line by line so that every complaint can name its line.
//!
//! No file of this kind quotes its fields, and a general CSV reader counts comment, blank and CRLF lines in ways of its own.

use std::path::Path;

use libella_core::time::Timestamp;

use crate::fault::Fault;

/// One line of a table.
pub(crate) struct Row<'a> {
    path: &'a Path,
    /// Counted from 1.
    pub(crate) line: u64,
    fields: Vec<&'a str>,
}

/// The data lines of a text: neither blank, nor comments (`#`), nor a header of words in the first line.
pub(crate) fn rows<'a>(path: &'a Path, text: &'a str, separated_by_commas: bool) -> impl Iterator<Item = Row<'a>> {
    text.trim_start_matches('\u{feff}').lines().enumerate().filter_map(move |(index, content)| {
        let content = content.trim();
        if content.is_empty() || content.starts_with('#') {
            return None;
        }
        let fields: Vec<&str> =
            if separated_by_commas { content.split(',').map(str::trim).collect() } else { content.split_whitespace().collect() };
        let is_header =
            index == 0 && fields.first().is_some_and(|field| field.starts_with(|c: char| c.is_alphabetic()) && !is_number(field));
        (!is_header).then_some(Row { path, line: index as u64 + 1, fields })
    })
}

/// Whether the first data line of a text has commas.
pub(crate) fn has_commas(text: &str) -> bool {
    text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#')).is_some_and(|line| line.contains(','))
}

fn is_number(field: &str) -> bool {
    field.parse::<f64>().is_ok()
}

impl<'a> Row<'a> {
    /// A complaint about this line.
    pub(crate) fn fault(&self, what: impl Into<String>, remedy: impl Into<String>) -> Fault {
        Fault::malformed(self.path, what, remedy).line(self.line)
    }

    /// Refuses a line that is too short.
    pub(crate) fn at_least(&self, columns: usize) -> Result<(), Fault> {
        if self.fields.len() >= columns {
            return Ok(());
        }
        let what = format!("has {} of {columns} columns", self.fields.len());
        Err(self.fault(what, "the file is cut off or damaged: copy it again"))
    }

    /// The text in a column.
    pub(crate) fn text(&self, column: usize) -> Result<&'a str, Fault> {
        self.at_least(column + 1)?;
        let field = self.fields.get(column).copied().unwrap_or_default();
        if field.is_empty() {
            Err(self.fault(format!("column {} is empty", column + 1), "the file is damaged: copy it again"))
        } else {
            Ok(field)
        }
    }

    /// The finite number in a column.
    pub(crate) fn number(&self, column: usize) -> Result<f64, Fault> {
        let field = self.text(column)?;
        match field.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(self.fault(format!("column {} is `{field}`, not a finite number", column + 1), "remove the line or record again")),
            Err(_) => Err(self.fault(format!("column {} is `{field}`, not a number", column + 1), "correct or remove the line")),
        }
    }

    /// Finite numbers in neighbouring columns.
    pub(crate) fn numbers<const N: usize>(&self, first: usize) -> Result<[f64; N], Fault> {
        let mut values = [0.0; N];
        for (offset, value) in values.iter_mut().enumerate() {
            *value = self.number(first + offset)?;
        }
        Ok(values)
    }

    /// A small count in a column.
    pub(crate) fn index(&self, column: usize) -> Result<u32, Fault> {
        let field = self.text(column)?;
        field.parse().map_err(|_| self.fault(format!("column {} is `{field}`, not a count", column + 1), "correct or remove the line"))
    }

    /// The time stamp in the first column: nanoseconds where it is a whole number, else seconds.
    pub(crate) fn stamp(&self) -> Result<Timestamp, Fault> {
        let field = self.text(0)?;
        parse_stamp(field)
            .ok_or_else(|| self.fault(format!("`{field}` is not a time stamp"), "give nanoseconds, or seconds with a decimal point"))
    }
}

/// Exact to the nanosecond: seconds are split at the decimal point, not rounded through a float.
fn parse_stamp(field: &str) -> Option<Timestamp> {
    if let Ok(nanos) = field.parse::<i64>() {
        return Some(Timestamp::from_nanos(nanos));
    }
    if let Some((whole, fraction)) = field.split_once('.')
        && let Ok(seconds) = whole.parse::<i64>()
        && !whole.starts_with('-')
        && fraction.bytes().all(|byte| byte.is_ascii_digit())
    {
        let digits: String = fraction.chars().chain("000000000".chars()).take(9).collect();
        return Some(Timestamp::from_nanos(seconds.checked_mul(1_000_000_000)?.checked_add(digits.parse().ok()?)?));
    }
    let seconds: f64 = field.parse().ok()?;
    #[allow(clippy::cast_possible_truncation)]
    (seconds.is_finite() && seconds.abs() < 9e9).then(|| Timestamp::from_nanos((seconds * 1e9).round() as i64))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn stamps_keep_every_nanosecond() {
        assert_eq!(parse_stamp("1403636584763555584").unwrap().as_nanos(), 1_403_636_584_763_555_584);
        assert_eq!(parse_stamp("1403636584.763555584").unwrap().as_nanos(), 1_403_636_584_763_555_584);
        assert_eq!(parse_stamp("12.5").unwrap().as_nanos(), 12_500_000_000);
        assert_eq!(parse_stamp("1.4036365e9").unwrap().as_nanos(), 1_403_636_500_000_000_000);
        assert!(parse_stamp("noon").is_none() && parse_stamp("nan").is_none() && parse_stamp("1e300").is_none());
    }

    #[test]
    fn lines_are_counted_through_comments_blanks_and_carriage_returns() {
        let text = "#t,a\r\n1,2\r\n\r\n# more\r\n3\r\n";
        let rows: Vec<_> = rows(Path::new("x.csv"), text, true).collect();
        assert_eq!(rows.iter().map(|row| row.line).collect::<Vec<_>>(), [2, 5]);
        assert_eq!(
            rows[1].number(1).unwrap_err().to_string(),
            "x.csv line 5: has 1 of 2 columns; the file is cut off or damaged: copy it again"
        );
    }
}

//! A table for readers: aligned columns on a terminal, Markdown in a file, the best of a row in bold there.

/// What stands in a place of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A number; its remark follows it in brackets.
    Value(f64, Option<String>),
    /// Words.
    Text(String),
    /// There is nothing to say.
    Empty,
}

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What it is about.
    pub name: String,
    /// One per column.
    pub cells: Vec<Cell>,
}

/// Rows with names under columns with names.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// What stands over it.
    pub title: String,
    /// The name of the first column.
    pub corner: String,
    /// The other columns.
    pub columns: Vec<String>,
    /// The lines.
    pub rows: Vec<Row>,
    /// Digits after the decimal point.
    pub decimals: usize,
    /// Whether the smallest number of a row is its best.
    pub smallest_is_best: bool,
}

/// How a table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// For a terminal.
    Plain,
    /// For a file.
    Markdown,
}

impl Table {
    /// The text of the table, title first, with a line break at its end.
    #[must_use]
    pub fn render(&self, style: Style) -> String {
        let header = std::iter::once(self.corner.clone()).chain(self.columns.iter().cloned()).collect();
        let mut lines: Vec<Vec<String>> = vec![header];
        for row in &self.rows {
            let best = self.best(row);
            let cells = row.cells.iter().map(|cell| self.cell(cell, style, best.as_deref()));
            lines.push(std::iter::once(row.name.clone()).chain(cells).collect());
        }
        let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns)
            .map(|column| lines.iter().filter_map(|line| line.get(column)).map(|text| text.chars().count()).max().unwrap_or(0))
            .collect();
        let mut text = match style {
            Style::Plain => format!("{}\n", self.title),
            Style::Markdown => format!("### {}\n\n", self.title),
        };
        for (index, line) in lines.iter().enumerate() {
            text += &written(line, &widths, style);
            if index == 0 && style == Style::Markdown {
                text += &format!("|{}\n", (0..columns).map(|column| if column == 0 { "---|" } else { "---:|" }).collect::<String>());
            }
        }
        text
    }

    /// The smallest number as it is printed: what looks equal is equally good. Nothing where there is nothing to compare.
    fn best(&self, row: &Row) -> Option<String> {
        let values: Vec<f64> =
            row.cells.iter().filter_map(|cell| if let Cell::Value(value, _) = cell { Some(*value) } else { None }).collect();
        if !self.smallest_is_best || values.len() < 2 {
            return None;
        }
        values.into_iter().min_by(f64::total_cmp).map(|value| self.number(value))
    }

    fn number(&self, value: f64) -> String {
        format!("{value:.*}", self.decimals)
    }

    fn cell(&self, cell: &Cell, style: Style, best: Option<&str>) -> String {
        match cell {
            Cell::Empty => "–".into(),
            Cell::Text(text) => text.clone(),
            Cell::Value(value, remark) => {
                let number = self.number(*value);
                let is_bold = style == Style::Markdown && best == Some(number.as_str());
                let number = if is_bold { format!("**{number}**") } else { number };
                remark.as_ref().map_or(number.clone(), |remark| format!("{number} ({remark})"))
            }
        }
    }
}

/// A line; words stand left, numbers right.
fn written(line: &[String], widths: &[usize], style: Style) -> String {
    let padded: Vec<String> = line
        .iter()
        .zip(widths)
        .enumerate()
        .map(|(column, (text, width))| if column == 0 { format!("{text:<width$}") } else { format!("{text:>width$}") })
        .collect();
    match style {
        Style::Plain => format!("  {}\n", padded.join("  ").trim_end()),
        Style::Markdown => format!("| {} |\n", padded.join(" | ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let row = |name: &str, cells: [Cell; 3]| Row { name: name.into(), cells: cells.to_vec() };
        Table {
            title: "ATE".into(),
            corner: "sequence".into(),
            columns: ["mono", "+ CNN", "+ CNN + P"].map(String::from).to_vec(),
            rows: vec![
                row("V1_01", [Cell::Value(0.0251, None), Cell::Value(0.02, None), Cell::Value(0.020_04, None)]),
                row("V1_02", [Cell::Value(0.1, Some("1 of 5 lost".into())), Cell::Text("lost".into()), Cell::Empty]),
            ],
            decimals: 4,
            smallest_is_best: true,
        }
    }

    #[test]
    fn a_terminal_sees_columns() {
        let expected = "\
ATE
  sequence                  mono   + CNN  + CNN + P
  V1_01                   0.0251  0.0200     0.0200
  V1_02     0.1000 (1 of 5 lost)    lost          –
";
        assert_eq!(table().render(Style::Plain), expected);
    }

    #[test]
    fn markdown_has_the_best_in_bold_and_ties_share_it() {
        let expected = "\
### ATE

| sequence |                 mono |      + CNN |  + CNN + P |
|---|---:|---:|---:|
| V1_01    |               0.0251 | **0.0200** | **0.0200** |
| V1_02    | 0.1000 (1 of 5 lost) |       lost |          – |
";
        assert_eq!(table().render(Style::Markdown), expected);
    }
}

//! Small things that every part of a page needs: escaped text, numbers for people, data URIs, and the JSON that a script reads.

use std::fmt::Write as _;

/// A text as the content of an element or of an attribute in double quotes.
pub(super) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            // What no document may hold.
            control if control.is_control() && control != '\n' => {}
            other => safe.push(other),
        }
    }
    safe
}

/// JSON within a `script` element: nothing in it can end the element.
pub(super) fn json_for_script(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

/// A file as the address of itself.
pub(super) fn data_uri(kind: &str, bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = format!("data:{kind};base64,");
    for chunk in bytes.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|index| u32::from(chunk.get(index).copied().unwrap_or(0)));
        let whole = a << 16 | b << 8 | c;
        for place in 0..4 {
            let letter = if place <= chunk.len() { LETTERS.get((whole >> (18 - 6 * place) & 63) as usize).copied() } else { None };
            text.push(char::from(letter.unwrap_or(b'=')));
        }
    }
    text
}

/// A length with a unit that suits it: three digits at least.
pub(super) fn length(metres: f64) -> String {
    match metres.abs() {
        small if small < 0.01 => format!("{:.1} mm", metres * 1e3),
        small if small < 1.0 => format!("{:.1} cm", metres * 1e2),
        small if small < 10.0 => format!("{metres:.2} m"),
        _ => format!("{metres:.1} m"),
    }
}

/// A duration.
pub(super) fn duration(seconds: f64) -> String {
    if seconds < 90.0 {
        return format!("{seconds:.1} s");
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let whole = seconds.round() as u64;
    format!("{} min {:02} s", whole / 60, whole % 60)
}

/// A number with about three digits.
pub(super) fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !(1e-3..1e5).contains(&size) => format!("{value:.1e}"),
        size if size < 0.01 => format!("{value:.4}"),
        size if size < 0.1 => format!("{value:.3}"),
        size if size < 10.0 => format!("{value:.2}"),
        size if size < 100.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

/// A coordinate in a drawing, short.
pub(super) fn coordinate(text: &mut String, value: f64) {
    let start = text.len();
    // Writing to a String cannot fail.
    let _ = write!(text, "{value:.1}");
    if text.ends_with(".0") {
        text.truncate(text.len() - 2);
    }
    if text.get(start..) == Some("-0") {
        text.truncate(start);
        text.push('0');
    }
}

/// Rows of names and values.
pub(super) fn table(rows: &[(String, String)]) -> String {
    let rows: String = rows.iter().map(|(name, value)| format!("<tr><th>{}</th><td>{}</td></tr>", escape(name), escape(value))).collect();
    format!("<table class=\"plain\"><tbody>{rows}</tbody></table>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_standard_examples() {
        for (text, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")] {
            assert_eq!(data_uri("x", text.as_bytes()), format!("data:x;base64,{coded}"));
        }
    }

    #[test]
    fn nothing_breaks_out_of_its_place() {
        assert_eq!(escape("<a href=\"x\">'&\u{7}"), "&lt;a href=&quot;x&quot;&gt;&#39;&amp;");
        assert_eq!(json_for_script(&serde_json::json!("</script><!--")), "\"\\u003c/script\\u003e\\u003c!--\"");
    }

    #[test]
    fn numbers_have_the_unit_that_suits_them() {
        assert_eq!([0.0064, 0.0241, 1.5, 80.46].map(length), ["6.4 mm", "2.4 cm", "1.50 m", "80.5 m"]);
        assert_eq!([17.0, 144.4].map(duration), ["17.0 s", "2 min 24 s"]);
    }
}

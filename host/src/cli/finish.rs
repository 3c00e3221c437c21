//! What `run` and `demo` end with: a coloured summary on a terminal, or the report as JSON.

use std::io::IsTerminal as _;
use std::path::Path;

use anstyle::{AnsiColor, Style};
use libella_host::dataset::Recording;
use libella_host::eval::Evaluation;
use libella_host::fault::Fault;
use libella_host::report::{Light, NO_TRUTH, Summary};

use super::say;

/// Prints how the run went; nothing unless standard output is a terminal.
pub(super) fn summarise(folder: &Path) -> Result<(), Fault> {
    let out = std::io::stdout();
    if out.is_terminal() {
        say(&painted(&Summary::of(folder)?, colours()));
    }
    Ok(())
}

/// Prints `report.json`, and says on standard error why it has no errors.
pub(super) fn print_json(folder: &Path, remark: Option<&str>) -> Result<(), Fault> {
    if let Some(remark) = remark {
        eprintln!("libella: {remark}");
    }
    let path = folder.join("report.json");
    let text = std::fs::read_to_string(&path);
    let text = text.map_err(|error| Fault::missing(&path, format!("cannot be read ({error})"), "run `libella run` again"))?;
    say(&text);
    if !text.ends_with('\n') {
        say("\n");
    }
    Ok(())
}

/// Why there are no errors, where there are none.
pub(super) fn unmeasured(recording: &Recording, evaluation: Option<&Evaluation>) -> Option<&'static str> {
    match (&recording.truth, evaluation) {
        (_, Some(_)) => None,
        (None, None) => Some(NO_TRUTH),
        (Some(_), None) => Some("no pose at a time of the ground truth: errors are not measured"),
    }
}

/// As <https://no-color.org> asks: any text in NO_COLOR turns colours off.
fn colours() -> bool {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    set("NO_COLOR").is_none() && set("TERM").is_none_or(|term| term != "dumb")
}

fn painted(summary: &Summary, colours: bool) -> String {
    let style = match summary.light {
        _ if !colours => Style::new(),
        Light::Good => AnsiColor::Green.on_default().bold(),
        Light::Fair => AnsiColor::Yellow.on_default().bold(),
        Light::Poor => AnsiColor::Red.on_default().bold(),
        Light::Unknown => Style::new().bold(),
    };
    format!("\n{style}{}{style:#}\n{}\n", summary.line, summary.headline)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_alone_has_the_colour_of_its_judgement() {
        let summary = |light| Summary { light, line: "tracked 98 %".into(), headline: "Tracked".into() };
        for (light, code) in [(Light::Good, "32"), (Light::Fair, "33"), (Light::Poor, "31")] {
            assert_eq!(painted(&summary(light), true), format!("\n\x1b[1m\x1b[{code}mtracked 98 %\x1b[0m\nTracked\n"));
            assert_eq!(painted(&summary(light), false), "\ntracked 98 %\nTracked\n");
        }
    }
}

//! The page of one run.

use std::fmt::Write as _;

use serde_json::Value;

use super::curves::{curves, depth};
use super::facts::{all_figures, configuration, protocol, warnings};
use super::first::first_screen;
use super::folder::Output;
use super::html::{data_uri, escape, json_for_script};
use super::sight::{what_it_saw, where_it_flew};
use super::space::Space;
use super::stages::{planes, time_and_memory};
use super::verdict::stretches;

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// A document around the content of its body.
pub(super) fn document(title: &str, body: &str, scene: Option<&Value>) -> String {
    let scene = scene.map(|scene| format!("<script type=\"application/json\" id=\"scene\">{}</script>", json_for_script(scene)));
    // An icon of its own, or a browser asks the server for one.
    let icon = data_uri("image/svg+xml", ICON.as_bytes());
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{}</title>\n<link rel=\"icon\" href=\"{icon}\"/>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n{}\n<script>{SCRIPT}</script>\n</body>\n</html>\n",
        escape(title),
        scene.unwrap_or_default(),
    )
}

const ICON: &str = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 16 16\"><path d=\"M2 13C5 2 9 14 14 3\" fill=\"none\" stroke=\"#1f5fbf\" stroke-width=\"3\"/></svg>";

/// The page.
pub(super) fn page(output: &Output) -> String {
    let stretches = stretches(output);
    let trouble = stretches.iter().filter(|stretch| !matches!(stretch.state, "tracking" | "initialising"));
    let space = Space::of(output, trouble.map(|stretch| (stretch.from_s, stretch.to_s)).collect());
    let mut body = first_screen(output, &stretches);
    body += "<main>";
    section(&mut body, "way", "Where it flew", &where_it_flew(output, &space));
    section(&mut body, "pictures", "What it saw", &what_it_saw(output));
    section(&mut body, "curves", "How wrong, and how sure", &curves(output, &stretches));
    section(&mut body, "depth", "Depth", &depth(output, &stretches));
    section(&mut body, "planes", "Planes", &planes(output));
    section(&mut body, "time", "Time and memory", &time_and_memory(output, &stretches));
    section(&mut body, "warnings", "Warnings", &warnings(output));
    section(&mut body, "figures", "All figures", &all_figures(output));
    section(&mut body, "protocol", "How this was measured", &protocol(output));
    section(&mut body, "configuration", "Configuration", &configuration(output));
    body += "</main>";
    let _ = write!(
        body,
        "<footer>libella {} · every number here stands in report.json, frames.csv or trajectory.csv of the folder “{}”</footer>",
        escape(output.text("/libella").unwrap_or("")),
        escape(&output.name)
    );
    document(&format!("{} · libella", output.dataset()), &body, Some(&space.json()))
}

fn section(body: &mut String, id: &str, title: &str, content: &str) {
    if !content.is_empty() {
        let _ = writeln!(body, "<section id=\"{id}\"><h2>{title}</h2>{content}</section>");
    }
}

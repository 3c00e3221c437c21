//! The report of a run as a reader's program sees it: whole, alone, and with the numbers of the files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use crate::support::recordings::data;
use libella_host::config::Config;
use libella_host::dataset::Recording;
use libella_host::eval::evaluate;
use libella_host::pipeline::{self, Report};
use libella_host::report::{Snapshots, write_comparison, write_data, write_page};
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight};
use libella_host::{dataset, planes};
use roxmltree::{Document, ParsingOptions};
use serde_json::Value;
use tempfile::TempDir;

/// A page may not be larger, bytes.
const LARGEST: usize = 3_000_000;

/// A short flight, the same without truth, and one that stands still and never starts: folders as `libella run` writes them.
struct Folders {
    temporary: TempDir,
}

impl Folders {
    fn path(&self, name: &str) -> PathBuf {
        self.temporary.path().join(name)
    }
}

fn folders() -> &'static Folders {
    static FOLDERS: OnceLock<Folders> = OnceLock::new();
    FOLDERS.get_or_init(|| {
        let folders = Folders { temporary: tempfile::tempdir().unwrap() };
        let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: 4.0, rest_s: 0.0, ..AnalyticConfig::default() };
        let source = MotionSource::Analytic(motion, ImuConfig::default());
        let flight = Arc::new(RenderedFlight::new(&source, &RenderConfig::default(), 2, 2).unwrap());
        let whole = || pipeline::rendered_recording("flight <1> & \"more\"", &flight).0;
        fly(&whole(), &folders.path("whole"));
        fly(&Recording { truth: None, ..whole() }, &folders.path("no_truth"));
        // Too short to start: half a second.
        let mut short = whole();
        let end = short.imu[0].stamp + libella_core::time::Span::from_millis(500);
        short.imu.retain(|sample| sample.stamp <= end);
        fly(&short, &folders.path("never"));
        folders
    })
}

/// What `libella run` does.
fn fly(recording: &Recording, folder: &Path) {
    let config = Config::default();
    let mut snapshots = Snapshots::new(recording.frames.len());
    let run = pipeline::run_watched(recording, &config, &AtomicBool::new(false), |frame, view| {
        if let Some(view) = view {
            snapshots.add(frame, &view);
        }
    })
    .unwrap();
    let evaluation = recording.truth.as_ref().and_then(|truth| evaluate(&run.trajectory(), truth, &config.evaluation).ok());
    let report = Report::new(recording, &config, &run, evaluation.as_ref());
    pipeline::write_outputs(folder, &run, &report).unwrap();
    planes::write(folder, run.planes.as_ref().unwrap()).unwrap();
    write_data(folder, recording, &config, &run, evaluation.as_ref(), Some(&snapshots)).unwrap();
    write_page(folder).unwrap();
}

fn page(name: &str) -> String {
    std::fs::read_to_string(folders().path(name).join("report.html")).unwrap()
}

/// The page as XML, which knows no forgiveness: scripts and styles are taken out first.
fn outline(page: &str) -> String {
    let mut rest = page.strip_prefix("<!DOCTYPE html>").unwrap();
    let mut kept = String::new();
    while let Some(begin) = ["<script", "<style"].iter().filter_map(|tag| rest.find(tag)).min() {
        let end = ["</script>", "</style>"].iter().filter_map(|tag| rest[begin..].find(tag)).min().unwrap();
        let open = begin + rest[begin..].find('>').unwrap() + 1;
        kept.push_str(&rest[..open]);
        rest = &rest[begin + end..];
        let close = rest.find('>').unwrap() + 1;
        kept.push_str(&rest[..close]);
        rest = &rest[close..];
    }
    kept + rest
}

fn parsed(outline: &str) -> Document<'_> {
    Document::parse_with_options(outline, ParsingOptions { nodes_limit: 200_000, ..ParsingOptions::default() }).unwrap()
}

fn json(folder: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("report.json")).unwrap()).unwrap()
}

/// Every figure that names its place in `report.json` has the value that stands there.
fn check_figures(element: roxmltree::Node<'_, '_>, report: &Value) -> usize {
    let mut checked = 0;
    for figure in element.descendants().filter(|node| node.has_attribute("data-figure")) {
        let pointer = figure.attribute("data-figure").unwrap();
        let said = figure.attribute("data-value").map(|value| value.parse::<f64>().unwrap());
        assert_eq!(said, report.pointer(pointer).and_then(Value::as_f64), "{pointer}");
        checked += 1;
    }
    checked
}

fn check_page(page: &str) {
    assert!(page.len() < LARGEST, "{} bytes", page.len());
    // Nothing is loaded from anywhere: neither by address nor relative to the page.
    for outside in ["http:", "https:", "src=\"//", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    let outline = outline(page);
    let document = parsed(&outline);
    let mut ids = BTreeSet::new();
    for node in document.descendants().filter(roxmltree::Node::is_element) {
        if let Some(id) = node.attribute("id") {
            assert!(ids.insert(id), "two elements are called {id}");
        }
        for name in ["src", "href"] {
            assert!(node.attribute(name).is_none_or(|address| address.starts_with("data:") || address.starts_with('#')));
        }
        for name in ["d", "x", "y", "width", "height", "cx", "cy", "style"] {
            let value = node.attribute(name).unwrap_or_default();
            assert!(!value.contains("NaN") && !value.contains("inf"), "{}: {value}", node.tag_name().name());
        }
    }
    let referred = document.descendants().filter_map(|node| ["for", "aria-labelledby"].iter().find_map(|name| node.attribute(*name)));
    let anchors = document.descendants().filter_map(|node| node.attribute("href")?.strip_prefix('#'));
    for id in referred.chain(anchors) {
        assert!(ids.contains(id), "{id} is referred to and not there");
    }
    if ids.contains("view") {
        assert!(page.contains("id=\"scene\""), "the view in space has nothing to show");
    }
}

#[test]
fn a_page_is_well_formed_and_says_what_the_files_say() {
    let (page, folder) = (page("whole"), folders().path("whole"));
    check_page(&page);
    let (outline, report) = (outline(&page), json(&folder));
    let document = parsed(&outline);
    assert!(check_figures(document.root_element(), &report) >= 9);
    let shown: Vec<_> =
        document.descendants().filter(|node| node.attribute("class") == Some("value")).filter_map(|node| node.text()).collect();
    let number = |pointer: &str| report.pointer(pointer).unwrap().as_f64().unwrap();
    let ate = number("/ate_rmse_m");
    let ate = if ate < 0.01 { format!("{:.1} mm", ate * 1e3) } else { format!("{:.1} cm", ate * 1e2) };
    let coverage = format!("{:.1} %", 100.0 * number("/coverage"));
    assert_eq!((shown.len(), shown[0], shown[2]), (5, ate.as_str(), coverage.as_str()));
    // The name of a recording is text, whatever letters it has.
    assert_eq!(document.descendants().find(|node| node.has_tag_name("h1")).unwrap().text(), Some("flight <1> & \"more\""));
    for id in
        ["health", "top", "side", "view", "error", "nees", "gyro-bias", "accel-bias", "stages", "pictures", "protocol", "configuration"]
    {
        assert!(document.descendants().any(|node| node.attribute("id") == Some(id)), "{id} is missing");
    }
    let scene = page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap();
    let scene: Value = serde_json::from_str(scene).unwrap();
    assert_eq!(scene["way"].as_array().unwrap().len(), report["poses"].as_u64().unwrap() as usize);
}

#[test]
fn the_rows_of_the_frames_are_those_of_the_run() {
    let folder = folders().path("whole");
    let (text, report) = (std::fs::read_to_string(folder.join("frames.csv")).unwrap(), json(&folder));
    let names: Vec<_> = text.lines().next().unwrap().split(',').map(|name| name.split('[').next().unwrap().trim().to_owned()).collect();
    let column = |name: &str| {
        let place = names.iter().position(|known| known == name).unwrap();
        text.lines().skip(1).map(|line| line.split(',').nth(place).unwrap().parse::<f64>().ok()).collect::<Vec<_>>()
    };
    assert!(text.lines().all(|line| line.split(',').count() == names.len()));
    assert_eq!(column("has_pose").iter().flatten().sum::<f64>(), report["poses"].as_f64().unwrap());
    let errors: Vec<f64> = column("error").into_iter().flatten().collect();
    let rmse = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    // Six digits of a metre in the file.
    assert!((rmse - report["ate_rmse_m"].as_f64().unwrap()).abs() < 1e-6);
    // The truth in the estimator's world is as far from the poses as the file says.
    let poses = std::fs::read_to_string(folder.join("trajectory.csv")).unwrap();
    let poses: Vec<Vec<f64>> =
        poses.lines().skip(1).map(|line| line.split(',').skip(1).map(|field| field.parse().unwrap()).collect()).collect();
    let truth: Vec<_> = ["truth_x", "truth_y", "truth_z"].map(column).into();
    let with_pose = (0..column("error").len()).filter(|row| column("has_pose")[*row] == Some(1.0));
    for (pose, row) in poses.iter().zip(with_pose).step_by(7) {
        let off = (0..3).map(|axis| (pose[axis] - truth[axis][row].unwrap()).powi(2)).sum::<f64>().sqrt();
        assert!((off - column("error")[row].unwrap()).abs() < 3e-6, "row {row}");
    }
    let nees: Vec<f64> = column("nees").into_iter().flatten().collect();
    let mean = nees.iter().sum::<f64>() / nees.len() as f64;
    assert!((mean - report["pose_nees"]["mean"].as_f64().unwrap()).abs() < 1e-3);
    // Motion tells the biases: what is left of their uncertainty at the end is less than at first.
    let sigma: Vec<f64> = column("sigma_gyro_bias_x").into_iter().flatten().collect();
    assert!(sigma.len() > 3 && sigma.iter().all(|sigma| *sigma > 0.0) && sigma.last() < sigma.first(), "{sigma:?}");
}

#[test]
fn without_truth_and_without_a_start_the_page_says_so() {
    let said = page("no_truth");
    check_page(&said);
    let outline = outline(&said);
    let document = parsed(&outline);
    check_figures(document.root_element(), &json(&folders().path("no_truth")));
    assert!(said.contains("there are no true poses to compare with"));
    assert!(!document.descendants().any(|node| matches!(node.attribute("id"), Some("error" | "nees"))));
    assert!(document.descendants().any(|node| node.attribute("id") == Some("gyro-bias")));
    let never = page("never");
    check_page(&never);
    assert!(never.contains("It never started: there is no trajectory") && never.contains("class=\"verdict poor\""));
}

#[test]
fn several_runs_stand_on_one_page() {
    let folders = ["whole", "no_truth", "never"].map(|name| folders().path(name));
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("compare.html");
    write_comparison(&folders, &path).unwrap();
    let page = std::fs::read_to_string(&path).unwrap();
    check_page(&page);
    let outline = outline(&page);
    let document = parsed(&outline);
    for folder in &folders {
        let name = folder.file_name().unwrap().to_str();
        let row = document.descendants().find(|node| node.attribute("data-folder") == name).unwrap();
        assert_eq!(check_figures(row, &json(folder)), 5);
    }
}

#[test]
fn an_older_folder_has_a_page_and_a_damaged_one_a_reason() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let reason = || write_page(folder).unwrap_err().to_string();
    assert!(reason().contains("there is no such file"));
    for name in ["report.json", "trajectory.csv"] {
        std::fs::copy(folders().path("whole").join(name), folder.join(name)).unwrap();
    }
    write_page(folder).unwrap();
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    check_page(&page);
    assert!(page.contains("the folder has no frames.csv"));
    std::fs::write(folder.join("frames.csv"), "#timestamp [ns],health\n5,tracking\n4,tracking\n").unwrap();
    assert!(reason().contains("frames.csv line 3: time stamps do not increase"), "{}", reason());
    std::fs::remove_file(folder.join("frames.csv")).unwrap();
    std::fs::create_dir(folder.join("views")).unwrap();
    let view = |name: &str| {
        let entry =
            serde_json::json!([{"stamp_ns": 1, "seconds": 0.0, "health": "tracking", "size_px": [4, 4], "image": name, "corners": []}]);
        std::fs::write(folder.join("views/views.json"), entry.to_string()).unwrap();
    };
    view("../report.json");
    assert!(reason().contains("which is no picture beside it"), "{}", reason());
    view("absent.jpg");
    assert!(reason().contains("absent.jpg: cannot be read"), "{}", reason());
    std::fs::write(folder.join("report.json"), "{}\n").unwrap();
    assert!(reason().contains("the run did not come to its end"));
}

/// The browser that `LIBELLA_CHROMIUM` names, or one in the `PATH`.
fn chromium() -> Option<PathBuf> {
    let named = std::env::var_os("LIBELLA_CHROMIUM").map(PathBuf::from);
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).collect();
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome-headless-shell"];
    let found = names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file());
    named.or(found)
}

/// Opens pages in frames as wide as a screen and as a phone: no script fails, nothing has to be scrolled sideways.
#[test]
fn a_browser_shows_it_without_errors() {
    let Some(browser) = chromium() else {
        println!("skipped: no Chromium in LIBELLA_CHROMIUM or the PATH");
        return;
    };
    let temporary = tempfile::tempdir().unwrap();
    let compare = temporary.path().join("compare.html");
    write_comparison(&[folders().path("whole"), folders().path("never")], &compare).unwrap();
    let mut pages: Vec<_> = ["whole", "no_truth", "never"].map(|name| folders().path(name).join("report.html")).into();
    pages.push(compare);
    for page in pages {
        let frames: String = [1280, 390]
            .map(|width| format!("<iframe width=\"{width}\" height=\"800\" src=\"file://{}\"></iframe>", page.display()))
            .concat();
        let look = "addEventListener('load', () => { document.body.dataset.seen = JSON.stringify([...document.querySelectorAll('iframe')].map(\
                    frame => { const root = frame.contentDocument.documentElement;\
                    return [root.dataset.ready, root.dataset.error || '', root.scrollWidth <= frame.clientWidth]; })); });";
        let around = temporary.path().join("around.html");
        std::fs::write(&around, format!("<!DOCTYPE html><body>{frames}<script>{look}</script></body>")).unwrap();
        let profile = temporary.path().join("profile");
        let output = Command::new(&browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files", "--virtual-time-budget=4000"])
            .arg(format!("--user-data-dir={}", profile.display()))
            .args(["--window-size=1400,900", "--dump-dom"])
            .arg(format!("file://{}", around.display()))
            .output()
            .unwrap();
        let dom = String::from_utf8_lossy(&output.stdout);
        let seen = dom.split("data-seen=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default().replace("&quot;", "\"");
        assert_eq!(seen, "[[\"1\",\"\",true],[\"1\",\"\",true]]", "{}: {}", page.display(), String::from_utf8_lossy(&output.stderr));
    }
}

/// The page of a real flight stays small.
#[test]
fn a_real_flight_fits_in_three_megabytes() {
    let Some(folder) = data("euroc/MH_01_easy") else { return };
    let recording = dataset::open(&folder, &Config::default().dataset).unwrap();
    let temporary = tempfile::tempdir().unwrap();
    fly(&recording, temporary.path());
    let page = std::fs::read_to_string(temporary.path().join("report.html")).unwrap();
    check_page(&page);
    assert!(check_figures(parsed(&outline(&page)).root_element(), &json(temporary.path())) >= 9);
}

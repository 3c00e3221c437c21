//! What a suite consists of: read from a file, or found in a folder of EuRoC.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{EUROC, Variant, euroc_name};
use crate::config::Config;
use crate::fault::{Fault, FaultKind, read_text};
use crate::sim::MotionKind;

/// The most runs of one variant: what is more does not move a median.
const MOST_RUNS: u32 = 100;
/// The environment variable that names the folder of the recordings.
const DATA_VARIABLE: &str = "LIBELLA_DATA";

/// Sequences, variants, runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The name of the suite.
    pub name: String,
    /// Runs of each variant on each sequence.
    pub runs: u32,
    /// Columns of the table.
    pub variants: Vec<Variant>,
    /// What gives depth, as `--depth` names it.
    pub depth: String,
    /// What all variants start from.
    pub config: Config,
    /// Rows of the table.
    pub sequences: Vec<Sequence>,
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// The name of the row.
    pub name: String,
    /// Where its recording is.
    pub source: Source,
}

/// Where a recording comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// It is there.
    Recording(PathBuf),
    /// It is rendered, once.
    Simulated(Simulation),
}

/// A flight to be rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// The name of a motion, or the folder of a recorded one.
    pub motion: String,
    /// Seed of the room and of all noise.
    pub scene_seed: u64,
    /// Seconds of flight; all of a recorded motion, and 60 of a drawn one, without it.
    pub duration_s: Option<f64>,
    /// Whether the room is poor in texture.
    pub is_bare: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanToml {
    name: String,
    #[serde(default = "usual_runs")]
    runs: u32,
    #[serde(default = "usual_variants")]
    variants: Vec<Variant>,
    #[serde(default = "usual_depth")]
    depth: String,
    config: Option<PathBuf>,
    #[serde(default)]
    sequences: Vec<SequenceToml>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SequenceToml {
    name: String,
    path: Option<PathBuf>,
    simulate: Option<SimulateToml>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SimulateToml {
    motion: String,
    #[serde(default = "usual_seed")]
    scene_seed: u64,
    duration_s: Option<f64>,
    #[serde(default)]
    bare: bool,
}

fn usual_runs() -> u32 {
    5
}

fn usual_variants() -> Vec<Variant> {
    Variant::ALL.to_vec()
}

fn usual_depth() -> String {
    "indoor".into()
}

fn usual_seed() -> u64 {
    1
}

impl Simulation {
    /// The name of its folder: motion, room and, where it is bare or the flight ends early, that.
    #[must_use]
    pub fn folder_name(&self) -> String {
        let motion = Path::new(&self.motion).file_name().map_or_else(|| self.motion.clone(), |name| name.to_string_lossy().into_owned());
        let short = euroc_name(&motion).unwrap_or(motion.as_str());
        let seconds = self.duration_s.map(|seconds| format!("_{seconds}s")).unwrap_or_default();
        let bare = if self.is_bare { "_bare" } else { "" };
        format!("{short}_s{}{bare}{seconds}", self.scene_seed)
    }
}

impl Plan {
    /// Reads the file of a suite. Relative paths in it are looked for in `data` where that is given, else beside the file and in the
    /// folder that `LIBELLA_DATA` names.
    ///
    /// # Errors
    /// When the file is absent, is no TOML, has unknown keys, or describes what cannot be run.
    pub fn read(path: &Path, data: Option<&Path>) -> Result<Self, Fault> {
        let remedy = "give the file of a suite; suites/semi_real.toml of the sources is one";
        let text = read_text(path, remedy).map_err(|fault| Fault { kind: FaultKind::Configuration, ..fault })?;
        let beside = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let variable = std::env::var_os(DATA_VARIABLE).map(PathBuf::from);
        let folders: Vec<PathBuf> = match data {
            Some(data) => vec![data.into()],
            None => std::iter::once(beside.to_path_buf()).chain(variable).collect(),
        };
        Self::parse(&text, beside, &folders).map_err(|fault| if fault.path.is_none() { fault.at(path) } else { fault })
    }

    /// The suite of a text; relative recordings and motions are looked for in `folders`, the configuration in `beside`.
    fn parse(text: &str, beside: &Path, folders: &[PathBuf]) -> Result<Self, Fault> {
        let read: PlanToml = toml::from_str(text).map_err(|error| {
            let what = error.message().replace('\n', " ");
            let mut fault = refused(what, "compare it with suites/semi_real.toml of the sources");
            fault.line = error.span().map(|span| 1 + text.bytes().take(span.start).filter(|byte| *byte == b'\n').count() as u64);
            fault
        })?;
        let config = read.config.map_or_else(|| Ok(Config::default()), |path| Config::read(&beside.join(path)))?;
        let sequences = read.sequences.into_iter().map(|sequence| located(sequence, folders)).collect::<Result<_, _>>()?;
        Ok(Self { name: read.name, runs: read.runs, variants: read.variants, depth: read.depth, config, sequences })
    }

    /// The sequences of EuRoC that a folder holds, at most one folder further down, as its archives unpack.
    ///
    /// # Errors
    /// When there is none.
    pub fn euroc(folder: &Path) -> Result<Self, Fault> {
        let list = |folder: &Path| -> Vec<PathBuf> {
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
            let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
            paths.sort();
            paths
        };
        if !folder.is_dir() {
            return Err(Fault::missing(folder, "there is no such folder", "give the folder that holds V1_01_easy and others"));
        }
        let upper = list(folder);
        let candidates: Vec<PathBuf> = upper.iter().cloned().chain(upper.iter().flat_map(|folder| list(folder))).collect();
        let is_recording = |path: &&PathBuf| path.join("mav0").is_dir() || path.join("cam0").is_dir();
        let found = EUROC.into_iter().filter_map(|name| {
            let named = |path: &&PathBuf| path.file_name().is_some_and(|file| file.to_string_lossy().starts_with(name));
            let path = candidates.iter().filter(is_recording).find(named)?;
            Some(Sequence { name: name.into(), source: Source::Recording(path.clone()) })
        });
        let sequences: Vec<Sequence> = found.collect();
        if sequences.is_empty() {
            let what = "holds none of V1_01 to V2_03 and MH_01 to MH_05";
            return Err(Fault::missing(
                folder,
                what,
                "unpack the archives of EuRoC there, each to a folder like V1_01_easy with `mav0` in it",
            ));
        }
        Ok(Self {
            name: "EuRoC".into(),
            runs: usual_runs(),
            variants: usual_variants(),
            depth: usual_depth(),
            config: Config::default(),
            sequences,
        })
    }

    /// Refuses what cannot be run; to be called once all options are in.
    ///
    /// # Errors
    /// Names the first key that cannot be used.
    pub fn check(&self) -> Result<(), Fault> {
        if self.name.trim().is_empty() {
            return Err(refused("`name` is empty", "give the suite a name"));
        }
        if !(1..=MOST_RUNS).contains(&self.runs) {
            return Err(refused(format!("`runs` is {}", self.runs), format!("give 1 to {MOST_RUNS}")));
        }
        if self.sequences.is_empty() {
            return Err(refused("has no sequence", "add [[sequences]] with `name` and `path`, or `simulate`"));
        }
        if self.variants.is_empty() {
            return Err(refused("`variants` is empty", format!("give some of {}", all_names())));
        }
        if let Some(twice) = twice(self.variants.iter().map(|variant| variant.name())) {
            return Err(refused(format!("the variant `{twice}` occurs twice"), "leave one out"));
        }
        if let Some(twice) = twice(self.sequences.iter().map(|sequence| sequence.name.as_str())) {
            return Err(refused(format!("the sequence `{twice}` occurs twice"), "rows need names of their own"));
        }
        if let Some(variant) = self.variants.iter().find(|variant| variant.has_depth()).filter(|_| self.depth == "none") {
            let what = format!("the variant `{}` needs depth and `depth` is none", variant.name());
            return Err(refused(what, "give `depth`, or the variant mono alone"));
        }
        self.config.check()
    }
}

fn all_names() -> String {
    Variant::ALL.map(Variant::name).join(", ")
}

fn refused(what: impl Into<String>, remedy: impl Into<String>) -> Fault {
    Fault::new(FaultKind::Configuration, what, remedy)
}

fn twice<'a>(mut names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let mut seen = std::collections::BTreeSet::new();
    names.find(|name| !seen.insert(*name))
}

fn located(read: SequenceToml, folders: &[PathBuf]) -> Result<Sequence, Fault> {
    let name = read.name;
    if name.trim().is_empty() {
        return Err(refused("a sequence has an empty `name`", "name every row"));
    }
    let source = match (read.path, read.simulate) {
        (Some(path), None) => Source::Recording(find(&name, &path, folders)?),
        (None, Some(simulate)) => {
            let is_named = MotionKind::from_name(&simulate.motion).is_some();
            let motion =
                if is_named { simulate.motion } else { find(&name, Path::new(&simulate.motion), folders)?.to_string_lossy().into_owned() };
            if let Some(seconds) = simulate.duration_s.filter(|seconds| !(1.0..=3600.0).contains(seconds)) {
                return Err(refused(format!("sequence `{name}`: `duration_s` is {seconds}"), "give 1 to 3600 seconds"));
            }
            let SimulateToml { scene_seed, duration_s, bare: is_bare, .. } = simulate;
            Source::Simulated(Simulation { motion, scene_seed, duration_s, is_bare })
        }
        (None, None) => {
            return Err(refused(format!("sequence `{name}` has neither `path` nor `simulate`"), "say where its recording is"));
        }
        (Some(_), Some(_)) => {
            return Err(refused(format!("sequence `{name}` has both `path` and `simulate`"), "leave one out"));
        }
    };
    Ok(Sequence { name, source })
}

fn find(sequence: &str, path: &Path, folders: &[PathBuf]) -> Result<PathBuf, Fault> {
    // An absolute path stands for itself whatever it is joined to.
    folders.iter().map(|folder| folder.join(path)).find(|path| path.exists()).ok_or_else(|| {
        let places: Vec<String> = folders.iter().map(|folder| folder.display().to_string()).collect();
        let what = format!("sequence `{sequence}`: there is no {} in {}", path.display(), places.join(" or "));
        Fault::new(FaultKind::Missing, what, format!("give the folder of the data with --data, or set {DATA_VARIABLE}"))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Plan, Fault> {
        let plan = Plan::parse(text, Path::new("."), &[PathBuf::from("/nowhere")])?;
        plan.check()?;
        Ok(plan)
    }

    const ROW: &str = "[[sequences]]\nname = \"a\"\nsimulate = { motion = \"medium\" }\n";

    #[test]
    fn what_is_left_out_is_that_of_the_paper() {
        let plan = parse(&format!("name = \"x\"\n{ROW}")).unwrap();
        assert_eq!((plan.runs, plan.depth.as_str(), plan.variants.as_slice()), (5, "indoor", Variant::ALL.as_slice()));
        let Source::Simulated(flight) = &plan.sequences[0].source else { unreachable!() };
        assert_eq!((flight.scene_seed, flight.duration_s, flight.folder_name().as_str()), (1, None, "medium_s1"));
    }

    #[test]
    fn folders_of_rendered_flights_are_named_after_motion_and_room() {
        let flight =
            |motion: &str, duration_s, is_bare| Simulation { motion: motion.into(), scene_seed: 2, duration_s, is_bare }.folder_name();
        assert_eq!(flight("somewhere/V1_01_easy", None, false), "V1_01_s2");
        assert_eq!(flight("mine", Some(4.5), false), "mine_s2_4.5s");
        assert_eq!(flight("mine", Some(4.5), true), "mine_s2_bare_4.5s");
    }

    #[test]
    fn each_mistake_has_its_sentence() {
        let with = |text: &str| parse(text).unwrap_err().to_string();
        for (text, said) in [
            (format!("name = \"x\"\nrun = 3\n{ROW}"), "line 2: unknown field `run`"),
            (format!("name = \"x\"\nvariants = [\"cnn+x\"]\n{ROW}"), "unknown variant `cnn+x`"),
            (format!("name = \"x\"\nvariants = [\"cnn\", \"cnn\"]\n{ROW}"), "the variant `cnn` occurs twice"),
            (format!("name = \"x\"\nvariants = []\n{ROW}"), "`variants` is empty"),
            (format!("name = \"x\"\nruns = 0\n{ROW}"), "`runs` is 0; give 1 to 100"),
            (format!("name = \"x\"\ndepth = \"none\"\n{ROW}"), "the variant `cnn` needs depth"),
            (format!("name = \" \"\n{ROW}"), "`name` is empty"),
            ("name = \"x\"\n".into(), "has no sequence"),
            (format!("name = \"x\"\n{ROW}{ROW}"), "the sequence `a` occurs twice"),
            ("name = \"x\"\n[[sequences]]\nname = \"a\"\n".into(), "sequence `a` has neither `path` nor `simulate`"),
            ("name = \"x\"\n[[sequences]]\nname = \"a\"\npath = \"p\"\n".into(), "there is no p in /nowhere"),
            (format!("name = \"x\"\n{}", ROW.replace(" }", ", duration_s = 0.5 }")), "`duration_s` is 0.5"),
            (format!("name = \"x\"\n{}path = \"p\"\n", ROW), "has both `path` and `simulate`"),
            ("name = ".into(), "line 1"),
        ] {
            let fault = parse(&text).unwrap_err();
            let found = fault.line.map(|line| format!("line {line}: ")).unwrap_or_default() + &with(&text);
            assert!(found.contains(said) && found.lines().count() == 1, "{text}\n{found}");
        }
    }

    #[test]
    fn a_folder_of_euroc_gives_what_is_there_in_the_papers_order() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["MH_01_easy/mav0", "vicon_room1/V1_02_medium/mav0", "V1_01_easy/mav0", "V2_03_difficult"] {
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
        }
        let plan = Plan::euroc(folder.path()).unwrap();
        assert_eq!(plan.sequences.iter().map(|sequence| sequence.name.as_str()).collect::<Vec<_>>(), ["V1_01", "V1_02", "MH_01"]);
        let empty = folder.path().join("V2_03_difficult");
        assert_eq!(Plan::euroc(&empty).unwrap_err().kind, FaultKind::Missing);
    }
}

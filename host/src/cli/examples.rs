//! What the help of each subcommand ends with. A line that begins with `  libella` is a command line, and a test reads it as one.

pub(super) const DEMO: &str = "\
Examples:
  libella demo
  libella demo --trajectory difficult --dynamic 4 --out out/lively
  libella demo --scalar f32 --duration 10 --quiet";

pub(super) const CHECK: &str = "\
Examples:
  libella check MH_01_easy
  libella check flight.bag --calibration calib --image-topic /cam0/image_raw
  libella check MH_01_easy.zip --json > findings.json";

pub(super) const RUN: &str = "\
Examples:
  libella run MH_01_easy
  libella run MH_01_easy --depth indoor --planes use --smooth --out out/all
  libella run flight.bag --calibration calib --image-topic /cam0/image_raw --imu-topic /imu0
  libella run MH_01_easy --json --quiet > report.json";

pub(super) const REPORT: &str = "\
Examples:
  libella report out/MH_01_easy
  libella report out/a out/b out/c --out compare.html";

pub(super) const SIMULATE: &str = "\
Examples:
  libella simulate --out out/room
  libella simulate --trajectory medium --scene-seed 3 --dynamic 4 --duration 30 --out out/room
  libella simulate --trajectory V1_01_easy --no-depth --out out/V1_01_room";

pub(super) const ROOMS: &str = "\
Examples:
  libella rooms --out out/rooms
  libella rooms --rooms 1000 --views 24 --varied-camera --seed 100 --out out/training";

pub(super) const EVALUATE: &str = "\
Examples:
  libella evaluate out/MH_01_easy/trajectory.tum MH_01_easy/mav0/state_groundtruth_estimate0/data.csv
  libella evaluate estimate.tum truth.csv --json
  libella evaluate --suite suites/semi_real.toml --data recordings --fail-above 0.05
  libella evaluate --euroc EuRoC --variants mono,cnn+u+p --runs 3";

pub(super) const DEPTH: &str = "\
Examples:
  libella depth image.png
  libella depth MH_01_easy/mav0/cam0/data/1403636579763555584.png --out depth.png
  libella depth image.png --model mine.onnx --calibration cam0/sensor.yaml";

pub(super) const CONFIG: &str = "\
Examples:
  libella config > mine.toml
  libella run MH_01_easy --config mine.toml";

pub(super) const COMPLETIONS: &str = "\
Examples:
  libella completions bash > ~/.local/share/bash-completion/completions/libella
  libella completions zsh > ~/.zfunc/_libella
  libella completions fish > ~/.config/fish/completions/libella.fish
  libella completions powershell >> $PROFILE";

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use clap::{CommandFactory as _, Parser as _};

    use crate::cli::Arguments;

    #[test]
    fn the_help_of_each_subcommand_ends_with_two_to_four_command_lines_that_are_understood() {
        for command in Arguments::command().get_subcommands() {
            let name = command.get_name();
            let help = command.get_after_help().unwrap().to_string();
            let lines: Vec<&str> = help.lines().filter(|line| line.starts_with("  libella ")).collect();
            assert!((2..=4).contains(&lines.len()), "{name} has {} examples", lines.len());
            assert!(lines.iter().any(|line| line.trim_start().starts_with(&format!("libella {name}"))), "{name}");
            for line in lines {
                let words = line.split_whitespace().take_while(|word| !word.starts_with('>'));
                if let Err(error) = Arguments::try_parse_from(words) {
                    panic!("{line}: {error}");
                }
            }
        }
    }
}

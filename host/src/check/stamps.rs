//! Time stamps: unit, order, duplicates, gaps, jitter, and whether both sensors share a clock.
//!
//! # Method
//! The median interval tells the unit: inertial units in use give 40 to 2500 samples per second, cameras 0.9 to 250 images, and a
//! factor of 1000 leads out of either range. Stamps of the wrong unit are repaired in memory, so that later checks see what they can.

use libella_core::robust::stats;
use libella_core::time::{Span, Timestamp};

use super::Material;
use super::finding::{Clock, FindingKind, Findings, Severity};
use crate::dataset::{Layout, Recording, RemarkKind};

/// Shortest and longest median interval that is believed, ns.
const IMU_INTERVAL_NS: [f64; 2] = [4e5, 2.5e7];
const CAMERA_INTERVAL_NS: [f64; 2] = [4e6, 1.1e9];
/// What a wrong unit multiplies by, and its name.
const UNITS: [(f64, &str); 5] =
    [(1e3, "microseconds"), (1e6, "milliseconds"), (1e9, "seconds"), (1e-3, "picoseconds"), (1e-6, "femtoseconds")];
/// Pause between inertial samples beyond which integration loses more than a pixel in ordinary motion, ms, and the one where it is lost.
const IMU_GAP_MS: [f64; 2] = [50.0, 250.0];
/// The same for images: corners are followed across a few intervals, not across a second.
const IMAGE_GAP_MS: [f64; 2] = [500.0, 2000.0];
/// Robust spread of the interval over the interval: a stamp that wanders by a fifth was given by the receiving computer.
const JITTER_SHARE: f64 = 0.2;
/// Share of repeated stamps from which they are a fault of the recorder; fewer are a hiccup.
const DUPLICATE_FAULT_SHARE: f64 = 0.01;

/// The unit of a series of stamps, and the series in nanoseconds.
fn repair(name: &str, [shortest, longest]: [f64; 2], stamps: &mut [Timestamp], findings: &mut Findings) {
    let mut steps: Vec<f64> = intervals(stamps).filter(|step| *step > 0.0).collect();
    let Some(median) = stats::median(&mut steps) else { return };
    let fits = |factor: f64| (shortest..=longest).contains(&(median * factor));
    if fits(1.0) {
        return;
    }
    let measured = format!("the median interval of the {name}'s stamps, read as nanoseconds, is {median:.0} ns");
    let expected = format!("{:.1} ms to {:.0} ms between {name} stamps", shortest * 1e-6, longest * 1e-6);
    let Some((factor, unit)) = UNITS.into_iter().find(|(factor, _)| fits(*factor)) else {
        let change = format!("write the {name}'s time stamps as whole nanoseconds");
        findings.add(Severity::Fault, FindingKind::StampUnit, measured, expected, change);
        return;
    };
    let times = if factor > 1.0 { format!("multiply them by {factor:.0}") } else { format!("divide them by {:.0}", 1.0 / factor) };
    let change = format!("the {name}'s stamps are in {unit} where nanoseconds belong: {times}");
    findings.add(Severity::Fault, FindingKind::StampUnit, measured, expected, change);
    for stamp in stamps {
        let nanos = if factor > 1.0 {
            i128::from(stamp.as_nanos()) * factor as i128
        } else {
            i128::from(stamp.as_nanos()) / (1.0 / factor).round() as i128
        };
        *stamp = Timestamp::from_nanos(i64::try_from(nanos).unwrap_or(i64::MAX));
    }
}

fn intervals(stamps: &[Timestamp]) -> impl Iterator<Item = f64> + '_ {
    stamps.windows(2).map(|pair| (pair[1] - pair[0]).as_nanos() as f64)
}

/// Looks at all stamps, repairs their unit, and leaves `material` strictly increasing in time.
pub(super) fn check(recording: &Recording, material: &mut Material, findings: &mut Findings) {
    let mut imu: Vec<Timestamp> = material.imu.iter().map(|sample| sample.stamp).collect();
    repair("inertial unit", IMU_INTERVAL_NS, &mut imu, findings);
    for (sample, stamp) in material.imu.iter_mut().zip(&imu) {
        sample.stamp = *stamp;
    }
    repair("camera", CAMERA_INTERVAL_NS, &mut material.frames, findings);
    let frames = material.frames.clone();

    let noted = |kind: RemarkKind| recording.remarks.iter().find(|remark| remark.kind == kind).map_or(0, |remark| remark.count);
    for (name, stamps, left_out) in
        [("inertial unit", &imu, noted(RemarkKind::ImuDuplicate)), ("camera", &frames, noted(RemarkKind::ImageDuplicate))]
    {
        let repeated = left_out + intervals(stamps).filter(|step| *step == 0.0).count();
        if repeated > 0 {
            let share = repeated as f64 / stamps.len().max(1) as f64;
            let severity = if share >= DUPLICATE_FAULT_SHARE { Severity::Fault } else { Severity::Warning };
            let measured = format!("{repeated} of the {name}'s stamps occur twice ({:.1} %)", 100.0 * share);
            let change = format!("stamp the {name}'s data when they are taken, or remove the repeated lines");
            findings.add(severity, FindingKind::StampDuplicate, measured, "every stamp once", change);
        }
    }
    for (name, stamps, left_out) in
        [("inertial unit", &imu, noted(RemarkKind::ImuOrder)), ("camera", &frames, noted(RemarkKind::ImageOrder))]
    {
        let backwards = left_out + intervals(stamps).filter(|step| *step < 0.0).count();
        if backwards > 0 {
            let measured = format!("{backwards} of the {name}'s stamps are older than the one before");
            findings.add(
                Severity::Fault,
                FindingKind::StampOrder,
                measured,
                "stamps that rise from line to line",
                "sort the table by its first column",
            );
        }
    }
    for (name, kind) in [("inertial unit", RemarkKind::ImuLate), ("camera", RemarkKind::ImageLate)] {
        let late = noted(kind);
        if late > 0 {
            let measured = format!("{late} of the {name}'s messages were recorded after newer ones, and are sorted by their stamps");
            let change = "nothing, unless they come from a network that holds them back for longer than it should";
            findings.add(Severity::Note, FindingKind::StampOrder, measured, "messages in the order of their stamps", change);
        }
    }
    keep_rising(material);

    let imu: Vec<Timestamp> = material.imu.iter().map(|sample| sample.stamp).collect();
    let clock = clock(&imu);
    material.figures.imu = clock;
    gaps("inertial unit", "inertial samples", clock, IMU_GAP_MS, &imu, false, findings);
    let frames: Vec<Timestamp> = material.frames.clone();
    let clock = self::clock(&frames);
    material.figures.camera = clock;
    // A calibration target may leave the view: no corners, and no pause of the camera.
    let may_pause = recording.layout == Layout::Corners;
    gaps("camera", "images", clock, IMAGE_GAP_MS, &frames, may_pause, findings);
    share_a_clock(&imu, &frames, recording, findings);
}

/// Drops what is not newer than what came before.
fn keep_rising(material: &mut Material) {
    let mut last = None;
    material.imu.retain(|sample| {
        let rises = last.is_none_or(|last| sample.stamp > last);
        last = if rises { Some(sample.stamp) } else { last };
        rises
    });
    let mut last = None;
    let rises: Vec<bool> = material
        .frames
        .iter()
        .map(|stamp| {
            let rises = last.is_none_or(|last| *stamp > last);
            last = if rises { Some(*stamp) } else { last };
            rises
        })
        .collect();
    material.keep_frames(|index, _| rises.get(index).copied().unwrap_or(false));
}

fn clock(stamps: &[Timestamp]) -> Option<Clock> {
    let mut steps: Vec<f64> = intervals(stamps).collect();
    let longest = steps.iter().copied().fold(0.0, f64::max);
    let spread = stats::spread(&mut steps)?;
    (spread.median > 0.0).then(|| Clock { rate_hz: 1e9 / spread.median, jitter_ms: spread.sigma() * 1e-6, longest_gap_ms: longest * 1e-6 })
}

fn gaps(
    name: &str,
    what: &str,
    clock: Option<Clock>,
    [worth_a_word, fatal]: [f64; 2],
    stamps: &[Timestamp],
    may_pause: bool,
    findings: &mut Findings,
) {
    let Some(clock) = clock else { return };
    let interval_ms = 1e3 / clock.rate_hz;
    // A slow sensor pauses longer than that by itself.
    let (worth_a_word, fatal) = (worth_a_word.max(4.0 * interval_ms), fatal.max(20.0 * interval_ms));
    let pauses = intervals(stamps).filter(|step| step * 1e-6 > worth_a_word).count();
    if pauses > 0 {
        let severity = match clock.longest_gap_ms > fatal {
            _ if may_pause => Severity::Note,
            true => Severity::Fault,
            false => Severity::Warning,
        };
        let measured = format!("{pauses} pauses in the {what}, the longest {:.0} ms", clock.longest_gap_ms);
        let expected = format!("no pause beyond {worth_a_word:.0} ms at {:.1} Hz", clock.rate_hz);
        let change = format!("find out what blocks the recorder of the {name} (disk, USB, CPU), or cut the recording there");
        findings.add(severity, FindingKind::StampGap, measured, expected, change);
    }
    if clock.jitter_ms > JITTER_SHARE * interval_ms {
        let measured = format!("the {name}'s stamps jitter by {:.2} ms at an interval of {interval_ms:.2} ms", clock.jitter_ms);
        let expected = format!("jitter below {:.2} ms", JITTER_SHARE * interval_ms);
        let change = format!("use the {name}'s own clock for its stamps, not the time of arrival");
        findings.add(Severity::Warning, FindingKind::StampJitter, measured, expected, change);
    }
}

/// Both series must overlap, or they come from different clocks.
fn share_a_clock(imu: &[Timestamp], frames: &[Timestamp], recording: &Recording, findings: &mut Findings) {
    let (Some(imu_first), Some(imu_last), Some(first), Some(last)) = (imu.first(), imu.last(), frames.first(), frames.last()) else {
        return;
    };
    let apart = |span: Span| span.as_seconds::<f64>();
    let shared = apart((*imu_last).min(*last) - (*imu_first).max(*first));
    if shared <= 0.0 {
        let measured =
            format!("the first image is {:.1} s from the first inertial sample, and no time is shared", apart(*first - *imu_first));
        let change = "stamp both sensors by the same clock, or add the difference of the clocks to one of them";
        findings.add(Severity::Fault, FindingKind::Clock, measured, "images taken while the inertial unit is recorded", change);
        return;
    }
    // A boot of the recorder costs images at either end; a tenth of the recording is more than that.
    let outside = recording.listed_frames.saturating_sub(recording.frames.len());
    let share = outside as f64 / recording.listed_frames.max(1) as f64;
    if share > 0.1 {
        let measured = format!("{outside} of {} images lie outside of the inertial samples", recording.listed_frames);
        let change = "record both for the whole time, and check that both are stamped by the same clock";
        findings.add(Severity::Warning, FindingKind::Clock, measured, "inertial samples around every image", change);
    }
}

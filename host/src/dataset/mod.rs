//! Recordings on disk as one time-ordered stream of events.
//!
//! A recording is recognised by what it holds. Folders: `mav0` (or its content) is EuRoC/ASL and TUM-VI, `cam0` beside `imu0.csv` is
//! Kalibr's, `tracks_cam0.csv` beside `imu0.csv` is a recording of corners, `metadata.yaml` beside MCAP files is a ROS 2 bag. Files, told
//! by their first bytes: zip archives of such folders, ROS 1 bags, MCAP. Everything but pixels is read and checked before the first
//! event; pixels are read late, by a thread that runs a few images ahead, so that never more than a few are in memory.

mod archive;
mod corners;
mod decode;
mod euroc;
mod files;
mod frames;
mod hints;
mod imu;
mod log;
mod rig;
pub(crate) mod table;

pub use decode::{Decoded, GrayImage};
pub use frames::{Frames, ImageFile, ImageReader, ImageSource, ImageStore, LiveImages, PackedImage, PackedImages, Place};
pub use hints::Hints;

use std::io::Read as _;
use std::path::Path;
use std::sync::mpsc::Receiver;

use libella_core::imu::ImuSample;
use libella_core::time::{Span, Timestamp};
use libella_core::track::Observation;
use serde::Serialize;

use crate::calibration::Rig;
use crate::config::DatasetSection;
use crate::eval::Trajectory;
use crate::fault::Fault;

/// A recording whose files have been found and checked.
#[derive(Debug)]
pub struct Recording {
    /// A short name: that of its folder.
    pub name: String,
    /// The layout it was recognised as.
    pub layout: Layout,
    /// Camera, extrinsics and noise.
    pub rig: Rig,
    /// Inertial samples, strictly increasing in time.
    pub imu: Vec<ImuSample<f64>>,
    /// Images or corners, strictly increasing in time, all of them within the span of the inertial samples.
    pub frames: Frames,
    /// Images or corner sets listed by the recording, those outside of the inertial samples included.
    pub listed_frames: usize,
    /// Pose of the inertial unit, where the recording has it.
    pub truth: Option<Trajectory>,
    /// Whether the z axis of the truth's world is vertical.
    pub truth_is_level: bool,
    /// What is odd about it and does not stop a run.
    pub remarks: Vec<Remark>,
}

/// The layout of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// EuRoC/ASL with images, in a folder or an archive; TUM-VI and Kalibr's folders of images as well.
    Euroc,
    /// A ROS 1 bag.
    Bag,
    /// MCAP, as ROS 2 records it.
    Mcap,
    /// Corners of a calibration target, found beforehand.
    Corners,
    /// No folder: made by the program.
    Simulated,
}

/// The corners of one image.
#[derive(Debug, Clone)]
pub struct TrackFrame {
    /// When it was taken.
    pub stamp: Timestamp,
    /// The corners, raw pixels.
    pub observations: Vec<Observation<f64>>,
}

/// The kind of a [`Remark`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum RemarkKind {
    /// Inertial samples pause.
    ImuGap,
    /// An inertial time stamp occurs twice; the second sample is left out.
    ImuDuplicate,
    /// An inertial time stamp goes back; the sample is left out. Only of recordings opened to be checked.
    ImuOrder,
    /// An inertial sample was recorded after a newer one and is sorted in. Only of bags and MCAP files.
    ImuLate,
    /// An axis of the inertial unit stays at its largest value.
    ImuSaturated,
    /// Specific force far from gravity at the start.
    Gravity,
    /// Images pause.
    ImageGap,
    /// An image time stamp occurs twice; the second image is left out.
    ImageDuplicate,
    /// An image time stamp goes back; the image is left out. Only of recordings opened to be checked.
    ImageOrder,
    /// An image was recorded after a newer one and is sorted in. Only of bags and MCAP files.
    ImageLate,
    /// Images before the first or after the last inertial sample are left out.
    ImagesWithoutImu,
    /// A truth stamp occurs twice; the second pose is left out.
    TruthDuplicate,
    /// No truth to compare with.
    NoTruth,
    /// A value that the recording does not state was taken from elsewhere.
    Assumed,
}

/// Something odd in a recording that does not stop a run, with how often it occurs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Remark {
    /// What kind.
    pub kind: RemarkKind,
    /// How many times.
    pub count: usize,
    /// The first occurrence, with file and line.
    pub first: String,
}

/// Counts occurrences of one kind and remembers the first.
pub(crate) fn remark(remarks: &mut Vec<Remark>, kind: RemarkKind, first: impl FnOnce() -> String) {
    match remarks.iter_mut().find(|remark| remark.kind == kind) {
        Some(remark) => remark.count += 1,
        None => remarks.push(Remark { kind, count: 1, first: first() }),
    }
}

/// One thing that a sensor said.
#[derive(Debug)]
pub enum Event {
    /// An inertial sample.
    Imu(ImuSample<f64>),
    /// An image, or why it could not be read.
    Image {
        /// When it was taken.
        stamp: Timestamp,
        /// Its pixels.
        image: Result<GrayImage, Fault>,
    },
    /// Corners.
    Tracks(TrackFrame),
}

/// What a recording is opened for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// To be run: what cannot give a trajectory is refused.
    Run,
    /// To be checked: refused is only what cannot be read.
    Check,
}

/// Opens a recording and checks all of its tables.
///
/// # Errors
/// When it is no recording, or one of its parts is absent, damaged, out of order, or not finite.
pub fn open(path: &Path, options: &DatasetSection) -> Result<Recording, Fault> {
    open_with(path, options, &Hints::default())
}

/// The same, with calibration, truth or topics that are told.
///
/// # Errors
/// As [`open`]; and when a hint names what is not there.
pub fn open_with(path: &Path, options: &DatasetSection, hints: &Hints) -> Result<Recording, Fault> {
    open_for(Purpose::Run, path, options, hints)
}

/// Opens a recording to find out what is wrong with it: units, sizes, clocks and order that [`open`] refuses are left as they are.
/// Frames may lie outside of the inertial samples.
///
/// # Errors
/// When it is no recording, or one of its parts is absent, damaged, or not finite.
pub fn open_to_check(path: &Path, options: &DatasetSection) -> Result<Recording, Fault> {
    open_to_check_with(path, options, &Hints::default())
}

/// The same, with calibration, truth or topics that are told.
///
/// # Errors
/// As [`open_to_check`]; and when a hint names what is not there.
pub fn open_to_check_with(path: &Path, options: &DatasetSection, hints: &Hints) -> Result<Recording, Fault> {
    open_for(Purpose::Check, path, options, hints)
}

fn open_for(purpose: Purpose, path: &Path, options: &DatasetSection, hints: &Hints) -> Result<Recording, Fault> {
    let what_it_is = recognise(path)?;
    if !matches!(what_it_is, Kind::Bag | Kind::Mcap) {
        hints.refuse_topics(path)?;
    }
    let mut recording = match what_it_is {
        Kind::Folder => euroc::open(purpose, path, files::Files::Folder(path.to_path_buf()), options, hints)?,
        Kind::Zip => euroc::open(purpose, path, files::Files::Archive(archive::Archive::open(path)?), options, hints)?,
        Kind::Corners => corners::open(purpose, path, options)?,
        Kind::Bag => log::open(purpose, path, Layout::Bag, options, hints)?,
        Kind::Mcap => log::open(purpose, path, Layout::Mcap, options, hints)?,
    };
    if let Some(truth) = hints.truth()? {
        (recording.truth, recording.truth_is_level) = (Some(truth), false);
    }
    keep_frames_with_imu(purpose, &mut recording, path)?;
    skip_images(&mut recording, path, options.skip_images)?;
    report_image_gaps(&mut recording, path, options);
    if recording.truth.is_none() {
        remark(&mut recording.remarks, RemarkKind::NoTruth, || {
            format!("{}: no ground truth, so there will be no error figures", path.display())
        });
    }
    Ok(recording)
}

/// What a path turned out to be.
enum Kind {
    Folder,
    Corners,
    Zip,
    Bag,
    Mcap,
}

fn recognise(path: &Path) -> Result<Kind, Fault> {
    const FORMATS: &str =
        "give the folder of a recording (for EuRoC the one that holds `mav0`), its zip archive, a ROS 1 bag, or an MCAP file";
    if path.is_dir() {
        let is_ros2_bag = path.join("metadata.yaml").is_file() && !path.join("cam0").is_dir() && !path.join("mav0").is_dir();
        return Ok(match () {
            () if path.join("tracks_cam0.csv").is_file() => Kind::Corners,
            () if is_ros2_bag => Kind::Mcap,
            () => Kind::Folder,
        });
    }
    let unreadable = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => Fault::missing(path, "there is no such folder or file", FORMATS),
        _ => Fault::malformed(path, format!("cannot be read ({error})"), "check its permissions and the disk"),
    };
    let mut head = Vec::new();
    std::fs::File::open(path).and_then(|file| file.take(16).read_to_end(&mut head)).map_err(unreadable)?;
    match head.as_slice() {
        [b'P', b'K', 3, 4, ..] => Ok(Kind::Zip),
        [b'P', b'K', 5, 6, ..] => Err(Fault::malformed(path, "is an empty archive", "copy it again")),
        head if head.starts_with(b"#ROSBAG V2.0") => Ok(Kind::Bag),
        head if head.starts_with(b"#ROSBAG") => {
            Err(Fault::malformed(path, "is a bag of another version than 2.0", "convert it with `rosbag fix` or record again"))
        }
        head if head.starts_with(b"\x89MCAP0\r\n") => Ok(Kind::Mcap),
        head if head.starts_with(b"SQLite format 3") => {
            Err(Fault::malformed(path, "is a ROS 2 bag stored by sqlite3", "convert it to MCAP with `ros2 bag convert`"))
        }
        [0x28, 0xb5, 0x2f, 0xfd, ..] | [0x1f, 0x8b, ..] => Err(Fault::malformed(path, "is compressed as a whole", "unpack it first")),
        head if head.len() < 16 => Err(Fault::malformed(path, format!("is cut off: it has {} bytes", head.len()), "copy it again")),
        _ => Err(Fault::malformed(path, "is neither a zip archive nor a ROS 1 bag nor MCAP", FORMATS)),
    }
}

fn keep_frames_with_imu(purpose: Purpose, recording: &mut Recording, path: &Path) -> Result<(), Fault> {
    let (Some(first), Some(last)) = (recording.imu.first().map(|s| s.stamp), recording.imu.last().map(|s| s.stamp)) else {
        return Err(Fault::malformed(path, "has no inertial samples", "record or copy it again"));
    };
    let before = recording.frames.len();
    let inside = (0..before).filter_map(|index| recording.frames.stamp(index)).any(|stamp| first <= stamp && stamp <= last);
    if purpose == Purpose::Check && !inside && before > 0 {
        return Ok(());
    }
    recording.frames.retain(|stamp| first <= stamp && stamp <= last);
    let outside = before - recording.frames.len();
    if recording.frames.is_empty() {
        let what = "no image lies within the time span of the inertial samples";
        return Err(Fault::malformed(path, what, "check that both are stamped by the same clock, in nanoseconds"));
    }
    if outside > 0 {
        let first = format!("{}: image before the first or after the last inertial sample is left out", path.display());
        recording.remarks.push(Remark { kind: RemarkKind::ImagesWithoutImu, count: outside, first });
    }
    Ok(())
}

/// Leaves images out at the beginning.
fn skip_images(recording: &mut Recording, path: &Path, count: usize) -> Result<(), Fault> {
    if count == 0 {
        return Ok(());
    }
    let Some(first) = recording.frames.stamp(count) else {
        let what = format!("has {} images, and `dataset.skip_images` is {count}", recording.frames.len());
        return Err(Fault::malformed(path, what, "skip fewer"));
    };
    recording.frames.retain(|stamp| stamp >= first);
    recording.listed_frames = recording.listed_frames.saturating_sub(count);
    Ok(())
}

fn report_image_gaps(recording: &mut Recording, path: &Path, options: &DatasetSection) {
    for index in 1..recording.frames.len() {
        let (Some(earlier), Some(later)) = (recording.frames.stamp(index - 1), recording.frames.stamp(index)) else { continue };
        let gap_ms = (later - earlier).as_seconds::<f64>() * 1e3;
        if gap_ms > options.max_image_gap_ms {
            remark(&mut recording.remarks, RemarkKind::ImageGap, || {
                format!("{}: no image for {gap_ms:.0} ms before {later}", path.display())
            });
        }
    }
}

impl Recording {
    /// All events in the order in which an estimator wants them: an image follows the first inertial sample that is not
    /// older than it. At most `ahead` images are decoded before they are asked for.
    ///
    /// # Errors
    /// When the thread that decodes cannot be started.
    pub fn events(&self, ahead: usize) -> Result<Events<'_>, Fault> {
        let decoded = match &self.frames {
            Frames::Images(images) => Some(decode::start(images.clone(), ahead)?),
            Frames::Packed(packed) => Some(decode::start_packed(packed.store.reader()?, packed.images.clone(), ahead)?),
            Frames::Live(live) => Some(live.source.start(ahead)?),
            Frames::Tracks(_) => None,
        };
        Ok(Events { recording: self, decoded, next_imu: 0, next_frame: 0, reached: None })
    }

    /// The images of the given indices, which rise, decoded at most `ahead` before they are asked for. None of a recording of corners.
    ///
    /// # Errors
    /// When the thread that decodes cannot be started.
    pub(crate) fn images(&self, wanted: &[usize], ahead: usize) -> Result<impl Iterator<Item = Decoded>, Fault> {
        let decoded = match &self.frames {
            Frames::Images(images) => Some(decode::start(wanted.iter().filter_map(|index| images.get(*index).cloned()).collect(), ahead)?),
            Frames::Packed(packed) => {
                let images = wanted.iter().filter_map(|index| packed.images.get(*index).copied()).collect();
                Some(decode::start_packed(packed.store.reader()?, images, ahead)?)
            }
            Frames::Live(live) => Some(live.source.start(ahead)?),
            Frames::Tracks(_) => None,
        };
        let mut stamps = wanted.iter().filter_map(|index| self.frames.stamp(*index)).collect::<Vec<_>>().into_iter();
        Ok(std::iter::from_fn(move || {
            let stamp = stamps.next()?;
            // A source makes all images in order.
            decoded.as_ref()?.iter().find(|made| made.0 == stamp)
        }))
    }

    /// Time from the first to the last frame.
    #[must_use]
    pub fn span(&self) -> Span {
        match (self.frames.stamp(0), self.frames.stamp(self.frames.len().saturating_sub(1))) {
            (Some(first), Some(last)) => last - first,
            _ => Span::default(),
        }
    }
}

/// The events of a recording.
pub struct Events<'a> {
    recording: &'a Recording,
    decoded: Option<Receiver<Decoded>>,
    next_imu: usize,
    next_frame: usize,
    reached: Option<Timestamp>,
}

impl Iterator for Events<'_> {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        let due = self.recording.frames.stamp(self.next_frame).filter(|stamp| self.reached.is_some_and(|reached| reached >= *stamp));
        if let Some(stamp) = due {
            let index = self.next_frame;
            self.next_frame += 1;
            return match (&self.recording.frames, &self.decoded) {
                (Frames::Tracks(frames), _) => frames.get(index).cloned().map(Event::Tracks),
                // A source may make images that were taken out of the recording.
                (_, Some(decoded)) => decoded.iter().find(|made| made.0 == stamp).map(|(stamp, image)| Event::Image { stamp, image }),
                (_, None) => None,
            };
        }
        let sample = self.recording.imu.get(self.next_imu)?;
        self.next_imu += 1;
        self.reached = Some(sample.stamp);
        Some(Event::Imu(*sample))
    }
}

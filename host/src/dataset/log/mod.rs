//! Recordings of messages: ROS 1 bags and MCAP files.
//!
//! A first pass over the file takes the inertial samples and notes when and where images were; these are read again, chunk by chunk, when
//! they are asked for. Time is that of the messages' headers, not that of the recorder. Messages that were recorded out of order, as
//! happens where several programs publish, are sorted.

mod bag;
mod fields;
mod mcap;
mod messages;
mod store;
mod topics;
mod unpack;

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use libella_core::time::{Span, Timestamp};

use super::frames::{Frames, ImageStore as _, PackedImage, PackedImages};
use super::{Hints, Layout, Purpose, Recording, Remark, RemarkKind, imu, remark, rig};
use crate::config::DatasetSection;
use crate::fault::Fault;
use fields::Encoding;
use store::Store;
use topics::{Topic, Topics};

/// Messages that are recorded this much out of order are no accident of scheduling but a clock that jumps.
const MOST_DISORDER_S: f64 = 1.0;

/// A file of messages.
trait Container {
    /// The next chunk with what it says; `None` at the end.
    fn next_chunk(&mut self) -> Result<Option<Chunk>, Fault>;
    /// A chunk that has been seen before.
    fn chunk_at(&mut self, position: u64) -> Result<Chunk, Fault>;
}

/// Part of a file of messages, unpacked.
struct Chunk {
    position: u64,
    data: Vec<u8>,
    channels: Vec<Channel>,
    messages: Vec<Entry>,
}

/// Who sends messages.
struct Channel {
    id: u32,
    topic: String,
    type_name: String,
    /// How they are written, where it is known.
    encoding: Option<Encoding>,
}

/// Where a message lies in its chunk.
struct Entry {
    channel: u32,
    range: Range<usize>,
}

/// Opens a file of messages.
fn container(layout: Layout, path: &Path) -> Result<Box<dyn Container + Send>, Fault> {
    Ok(match layout {
        Layout::Bag => Box::new(bag::Bag::open(path)?),
        _ => Box::new(mcap::Mcap::open(path)?),
    })
}

/// Opens a bag, an MCAP file, or the folder of a ROS 2 bag.
pub(super) fn open(purpose: Purpose, path: &Path, layout: Layout, options: &DatasetSection, hints: &Hints) -> Result<Recording, Fault> {
    let files = files(path)?;
    let calibration = rig::of_bag(path, hints.calibration.as_deref())?;
    let mut topics = Topics::default();
    for (number, file) in files.iter().enumerate() {
        topics.gather(container(layout, file)?.as_mut(), u32::try_from(number).unwrap_or(u32::MAX))?;
    }
    let inertial = topics.inertial(path, hints.imu_topic.as_deref(), calibration.imu_topic.as_deref())?;
    let pictures = topics.pictures(path, hints.image_topic.as_deref(), calibration.image_topic())?;
    let camera = calibration.camera(Some(&pictures.name)).map_err(|fault| fault.at(path))?;
    let rig = calibration.rig(camera);

    let mut remarks = Vec::new();
    let Topic { name, mut samples, .. } = inertial;
    sort(purpose, path, &name, [RemarkKind::ImuLate, RemarkKind::ImuOrder], &mut samples, |sample| sample.stamp, &mut remarks)?;
    if let Some(sample) = samples.iter().find(|sample| !sample.gyro_rad_s.iter().chain(&sample.accel_m_s2).all(|value| value.is_finite())) {
        let what = format!("`{name}` at {}: a number is not finite", sample.stamp);
        return Err(Fault::malformed(path, what, "record again"));
    }
    let samples = imu::take(purpose, path, samples, options, &mut remarks)?;

    let Topic { name, mut images, content, encoding, .. } = pictures;
    sort(purpose, path, &name, [RemarkKind::ImageLate, RemarkKind::ImageOrder], &mut images, |image| image.stamp, &mut remarks)?;
    let before = images.len();
    images.dedup_by_key(|image| image.stamp);
    if images.len() < before {
        let first = format!("{}: `{name}`: a time stamp occurs twice; the second image is left out", path.display());
        remarks.push(Remark { kind: RemarkKind::ImageDuplicate, count: before - images.len(), first });
    }
    let store = Store { files, layout, topic: name, content, encoding };
    if purpose == Purpose::Run
        && let Some(image) = images.first().and_then(|image| store.reader().ok()?.read(image.place).ok())
    {
        let size = [image.width, image.height].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        rig::check_size(path, size.into(), &rig, &camera.source)?;
    }
    if camera.shift != Span::default() {
        images.iter_mut().for_each(|image| image.stamp = image.stamp + camera.shift);
    }
    let name = path.file_stem().map_or_else(|| "recording".into(), |name| name.to_string_lossy().into_owned());
    Ok(Recording {
        name,
        layout,
        rig,
        imu: samples,
        listed_frames: images.len(),
        frames: Frames::Packed(PackedImages { images, store: Arc::new(store) }),
        truth: None,
        truth_is_level: false,
        remarks,
    })
}

/// The file itself, or the files of a ROS 2 bag, which recorders number.
fn files(path: &Path) -> Result<Vec<PathBuf>, Fault> {
    if !path.is_dir() {
        return Ok(vec![path.to_path_buf()]);
    }
    let entries =
        std::fs::read_dir(path).map_err(|error| Fault::malformed(path, format!("cannot be read ({error})"), "check its permissions"))?;
    let all: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    let of = |ending: &str| all.iter().filter(|file| file.extension().is_some_and(|found| found == ending)).cloned().collect::<Vec<_>>();
    let mut files = of("mcap");
    // `x_10.mcap` follows `x_9.mcap`.
    files.sort_by_key(|file| (file.as_os_str().len(), file.clone()));
    if !files.is_empty() {
        return Ok(files);
    }
    if of("db3").is_empty() {
        return Err(Fault::missing(path, "is the folder of a ROS 2 bag without its MCAP files", "copy it again, whole"));
    }
    Err(Fault::malformed(path, "is a ROS 2 bag stored by sqlite3", "convert it to MCAP with `ros2 bag convert`"))
}

/// Puts what was recorded into the order of time.
fn sort<M>(
    purpose: Purpose,
    path: &Path,
    topic: &str,
    [late, jump]: [RemarkKind; 2],
    messages: &mut [M],
    stamp: impl Fn(&M) -> Timestamp,
    remarks: &mut Vec<Remark>,
) -> Result<(), Fault> {
    let mut newest: Option<Timestamp> = None;
    for message in messages.iter() {
        let stamp = stamp(message);
        if let Some(newest) = newest.filter(|newest| stamp < *newest) {
            let back_ms = (newest - stamp).as_seconds::<f64>() * 1e3;
            let jumps = back_ms > MOST_DISORDER_S * 1e3;
            if jumps && purpose == Purpose::Run {
                let what = format!("`{topic}`: the time stamps go back by {back_ms:.0} ms at {stamp}");
                return Err(Fault::malformed(path, what, "cut the recording where the clock jumps"));
            }
            remark(remarks, if jumps { jump } else { late }, || {
                format!("{}: `{topic}`: a message comes {back_ms:.3} ms late, and is sorted in", path.display())
            });
        }
        newest = newest.max(Some(stamp));
    }
    messages.sort_by_key(|message| stamp(message));
    Ok(())
}

fn open_file(path: &Path) -> Result<(BufReader<File>, u64), Fault> {
    let open = || -> std::io::Result<_> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok((BufReader::new(file), length))
    };
    open().map_err(|error| Fault::missing(path, format!("cannot be read ({error})"), "check its permissions and the disk"))
}

fn cut_off(path: &Path, remedy: &str) -> Fault {
    Fault::malformed(path, "is cut off", remedy)
}

fn damaged(path: &Path, reason: &str, remedy: &str) -> Fault {
    Fault::malformed(path, format!("is damaged: {}", reason.replace('\n', " ")), remedy)
}

//! The same recording in every format: one trajectory, bit for bit; and each format broken, which ends in one sentence.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use crate::support::Folder;
use crate::support::pack::{self, Message, Packing, Pixels, Wire};
use crate::support::recordings::data;
use libella_core::camera::CameraModel;
use libella_core::time::Span;
use libella_host::check::{CheckOptions, FindingKind, Severity, check};
use libella_host::config::Config;
use libella_host::dataset::{self, Event, Hints, Layout, Recording, RemarkKind};
use libella_host::fault::{Fault, FaultKind};
use libella_host::pipeline;
use libella_host::sim::{self, AnalyticConfig, AslOptions, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight};
use tempfile::TempDir;

fn open(path: &Path, hints: &Hints) -> Result<Recording, Fault> {
    dataset::open_with(path, &Config::default().dataset, hints)
}

/// Opens what must be refused, and returns the complaint, which is one sentence that names a place and a remedy.
fn refused(path: &Path, hints: &Hints) -> (FaultKind, String) {
    let fault = open(path, hints).map(|recording| recording.name).unwrap_err();
    let said = fault.to_string();
    assert!(!said.contains('\n') && !fault.remedy.is_empty() && fault.path.is_some(), "{said}");
    (fault.kind, said)
}

/// The poses of a run, bit for bit.
fn trajectory(path: &Path, hints: &Hints) -> Vec<[u64; 8]> {
    let recording = open(path, hints).unwrap();
    let run = pipeline::run(&recording, &Config::default(), &AtomicBool::new(false), |_| ()).unwrap();
    let bits = |pose: &pipeline::PoseResult| {
        let (p, q) = (pose.world_from_body.translation.vector, pose.world_from_body.rotation.coords);
        [pose.stamp.as_nanos() as f64, p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(f64::to_bits)
    };
    run.poses().map(bits).collect()
}

/// A recording in a temporary place, beside all that is made of it.
struct Packed {
    temporary: TempDir,
    mav0: PathBuf,
}

impl Packed {
    fn of(temporary: TempDir, mav0: PathBuf) -> Self {
        Self { temporary, mav0 }
    }

    /// The recording at rest.
    fn still() -> (Folder, Self) {
        let folder = Folder::new();
        let mav0 = folder.path("");
        (folder, Self::of(tempfile::tempdir().unwrap(), mav0))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.temporary.path().join(name)
    }

    fn zip(&self) -> PathBuf {
        let path = self.path("recording.zip");
        pack::zip(&self.mav0, &path, "mav0/");
        path
    }

    fn messages(&self, wire: Wire, pixels: Pixels) -> Vec<Message> {
        pack::messages(&self.mav0, wire, pixels)
    }

    fn bag(&self, packing: Packing) -> PathBuf {
        let path = self.path("recording.bag");
        pack::bag(&path, &self.messages(Wire::Ros1, Pixels::Mono8), packing, 40);
        path
    }

    fn mcap(&self, wire: Wire) -> PathBuf {
        let path = self.path("recording.mcap");
        pack::mcap(&path, &self.messages(wire, Pixels::Mono8), wire, Some(1 << 20));
        path
    }

    /// Bags hold no calibration: that of the folder is told.
    fn hints(&self) -> Hints {
        Hints { calibration: Some(self.mav0.clone()), ..Hints::default() }
    }
}

fn assert_one_trajectory(packed: &Packed, fewest: usize) {
    let expected = trajectory(&packed.mav0, &Hints::default());
    assert!(expected.len() > fewest, "{} poses", expected.len());
    let hints = packed.hints();
    assert!(trajectory(&packed.zip(), &Hints::default()) == expected, "zip");
    assert!(trajectory(&packed.bag(Packing::None), &hints) == expected, "bag");
    assert!(trajectory(&packed.mcap(Wire::Cdr), &hints) == expected, "MCAP");
}

#[test]
fn a_flight_gives_one_trajectory_through_every_format() {
    let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: 5.0, rest_s: 0.0, ..AnalyticConfig::default() };
    let source = MotionSource::Analytic(motion, ImuConfig::default());
    let rendered = RenderedFlight::new(&source, &RenderConfig::default(), 3, 3).unwrap();
    let temporary = tempfile::tempdir().unwrap();
    let options = AslOptions { right_camera: false, depth: false };
    sim::write_asl(temporary.path(), &rendered, &options, &mut |_, _| true).unwrap();
    let mav0 = temporary.path().join("mav0");
    assert_one_trajectory(&Packed::of(temporary, mav0), 20);
}

#[test]
fn a_real_recording_gives_one_trajectory_through_every_format() {
    let Some(folder) = data("euroc/MH_01_easy") else { return };
    assert_one_trajectory(&Packed::of(tempfile::tempdir().unwrap(), folder.join("mav0")), 300);
}

/// Everything that a recording says, to be compared: samples, and stamps and pixels of the images.
#[allow(clippy::type_complexity)] // inertial samples as bits; stamps with pixels
fn content(recording: &Recording) -> (Vec<[u64; 7]>, Vec<(i64, Vec<u8>)>) {
    let mut images = Vec::new();
    for event in recording.events(2).unwrap() {
        if let Event::Image { stamp, image } = event {
            images.push((stamp.as_nanos(), image.unwrap().pixels));
        }
    }
    let samples = recording.imu.iter().map(|sample| {
        let (w, a) = (sample.gyro_rad_s, sample.accel_m_s2);
        [sample.stamp.as_nanos() as f64, w.x, w.y, w.z, a.x, a.y, a.z].map(f64::to_bits)
    });
    (samples.collect(), images)
}

#[test]
fn every_variant_of_every_format_says_the_same() {
    let (folder, packed) = Packed::still();
    let expected = content(&folder.open().unwrap());
    assert_eq!((expected.0.len(), expected.1.len()), (201, 10));
    let hints = packed.hints();
    let same = |path: &Path, hints: &Hints, what: &str| {
        let recording = open(path, hints).unwrap();
        assert!(content(&recording) == expected, "{what}");
        assert_eq!(recording.rig, folder.open().unwrap().rig, "{what}");
        recording
    };
    let recording = same(&packed.zip(), &Hints::default(), "zip");
    assert!(recording.name == "recording" && recording.truth.is_some() && recording.remarks.is_empty(), "{:?}", recording.remarks);
    let deeper = packed.path("deeper.zip");
    pack::zip(&packed.mav0, &deeper, "MH_01_easy/mav0/");
    same(&deeper, &Hints::default(), "zip with a folder above");
    for packing in [Packing::None, Packing::Bz2, Packing::Lz4] {
        assert_eq!(same(&packed.bag(packing), &hints, &format!("{packing:?}")).layout, Layout::Bag);
    }
    for wire in [Wire::Cdr, Wire::Ros1] {
        assert_eq!(same(&packed.mcap(wire), &hints, &format!("{wire:?}")).layout, Layout::Mcap);
        for pixels in [Pixels::Bgr8, Pixels::Compressed] {
            let path = packed.path("other.mcap");
            pack::mcap(&path, &packed.messages(wire, pixels), wire, None);
            same(&path, &hints, &format!("{wire:?} {pixels:?} without chunks"));
        }
    }
}

/// Bags and MCAP that were written by another program (`golden/formats/make.py`), with each compression.
#[test]
fn what_others_wrote_is_read() {
    let (folder, packed) = Packed::still();
    let expected = content(&folder.open().unwrap());
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/formats");
    for name in ["still.bz2.bag", "still.lz4.bag", "still_ros2", "still_ros2/still_ros2.mcap"] {
        let recording = open(&golden.join(name), &packed.hints()).unwrap();
        assert!(content(&recording) == expected, "{name}");
        assert_eq!(recording.remarks.iter().map(|remark| remark.kind).collect::<Vec<_>>(), [RemarkKind::NoTruth], "{name}");
    }
}

#[test]
fn messages_out_of_order_are_sorted_in_and_a_truth_is_taken_from_a_file() {
    let (folder, packed) = Packed::still();
    let expected = content(&folder.open().unwrap());
    let mut messages = packed.messages(Wire::Cdr, Pixels::Mono8);
    // Samples change places with those 10 ms later, an image with the next one, and one sample comes twice.
    messages.swap(20, 22);
    let images: Vec<usize> = (0..messages.len()).filter(|index| messages[*index].topic == pack::IMAGE_TOPIC).collect();
    messages.swap(images[3], images[4]);
    let again = Message { bytes: messages[50].bytes.clone(), ..messages[50] };
    messages.insert(51, again);
    let path = packed.path("disorder.mcap");
    pack::mcap(&path, &messages, Wire::Cdr, Some(4096));
    let hints = Hints { truth: Some(folder.path("state_groundtruth_estimate0/data.csv")), ..packed.hints() };
    let recording = open(&path, &hints).unwrap();
    assert!(content(&recording) == expected);
    assert_eq!(recording.truth.as_ref().unwrap().poses().len(), 201);
    let kinds: Vec<_> = recording.remarks.iter().map(|remark| (remark.kind, remark.count)).collect();
    assert_eq!(kinds, [(RemarkKind::ImuLate, 2), (RemarkKind::ImuDuplicate, 1), (RemarkKind::ImageLate, 1)]);
    // What is put right by itself is no fault of the recording.
    let opened = dataset::open_to_check_with(&path, &Config::default().dataset, &hints).unwrap();
    let report = check(&opened, &CheckOptions::default()).unwrap();
    let order: Vec<_> = report.findings.iter().filter(|finding| finding.kind == FindingKind::StampOrder).collect();
    assert!(order.len() == 2 && order.iter().all(|finding| finding.severity == Severity::Note), "{report}");
}

const CHAIN: &str = "cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  intrinsics: [40.0, 40.0, 32.0, 24.0]
  distortion_model: equidistant
  distortion_coeffs: [0.0034, 0.0007, -0.0020, 0.0002]
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.06]
  - [-1.0, 0.0, 0.0, -0.02]
  - [0.0, 0.0, 1.0, -0.01]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: 0.0125
  rostopic: /cam0/image_raw
  resolution: [64, 48]
";

const UNIT: &str = "#Accelerometers
accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
gyroscope_noise_density: 1.6968e-04
gyroscope_random_walk: 1.9393e-05
rostopic: /imu0
update_rate: 200.0
";

/// A folder with Kalibr's two files.
fn kalibr() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("calib-camchain-imucam.yaml"), CHAIN).unwrap();
    std::fs::write(folder.path().join("calib-camchain.yaml"), "cam0:\n  camera_model: pinhole\n").unwrap();
    std::fs::write(folder.path().join("imu.yaml"), UNIT).unwrap();
    folder
}

/// The chain above says in Kalibr's words what `Folder` says in those of ASL, but for the lens and the clock.
fn assert_kalibr(recording: &Recording, asl: &Recording) {
    let apart = recording.rig.body_from_camera.inverse() * asl.rig.body_from_camera;
    assert!(apart.translation.vector.norm() < 1e-12 && apart.rotation.angle() < 1e-12, "{apart}");
    assert_eq!(recording.rig.imu_noise, asl.rig.imu_noise);
    assert!(matches!(recording.rig.camera, CameraModel::KannalaBrandt(camera) if camera.distortion[1] == 0.0007));
    for index in 0..10 {
        // t_imu = t_cam + shift
        assert_eq!(recording.frames.stamp(index).unwrap() - asl.frames.stamp(index).unwrap(), Span::from_nanos(12_500_000));
    }
}

#[test]
fn kalibrs_files_are_found_in_the_recording_beside_it_and_where_they_are_told_to_be() {
    let (folder, packed) = Packed::still();
    let asl = folder.open().unwrap();
    let told = kalibr();
    let hints = Hints { calibration: Some(told.path().to_path_buf()), ..Hints::default() };
    // Told, for the folder itself.
    assert_kalibr(&open(folder.root(), &hints).unwrap(), &asl);
    // Beside a bag.
    let bag = packed.bag(Packing::Lz4);
    let beside = told.path().join("beside.bag");
    std::fs::copy(bag, &beside).unwrap();
    assert_kalibr(&open(&beside, &Hints::default()).unwrap(), &asl);
    // TUM-VI: no sensor.yaml in `mav0`, and Kalibr's files in `dso`; as a folder and packed.
    let tum = Folder::new();
    for file in ["cam0/sensor.yaml", "imu0/sensor.yaml"] {
        std::fs::remove_file(tum.path(file)).unwrap();
    }
    std::fs::rename(tum.path("state_groundtruth_estimate0"), tum.path("mocap0")).unwrap();
    let dso = tum.root().join("dso");
    std::fs::create_dir(&dso).unwrap();
    std::fs::write(dso.join("camchain.yaml"), CHAIN).unwrap();
    std::fs::write(dso.join("imu_config.yaml"), UNIT).unwrap();
    let recording = open(tum.root(), &Hints::default()).unwrap();
    assert_kalibr(&recording, &asl);
    assert_eq!(recording.truth.unwrap().poses().len(), 201);
    let archive = packed.path("tum.zip");
    pack::zip(tum.root(), &archive, "dataset-room1_512_16/");
    assert_kalibr(&open(&archive, &Hints::default()).unwrap(), &asl);
    // Kalibr's own folder: images named by their time, without a list, beside imu0.csv.
    for (index, name) in std::fs::read_dir(folder.path("cam0/data")).unwrap().enumerate() {
        let from = name.unwrap().path();
        std::fs::create_dir_all(told.path().join("cam0")).unwrap();
        std::fs::copy(&from, told.path().join("cam0").join(from.file_name().unwrap())).unwrap();
        assert!(index < 10);
    }
    std::fs::copy(folder.path("imu0/data.csv"), told.path().join("imu0.csv")).unwrap();
    let recording = open(told.path(), &Hints::default()).unwrap();
    assert_kalibr(&recording, &asl);
    assert_eq!(recording.imu, asl.imu);
}

#[test]
fn topics_are_chosen_by_option_by_the_calibration_or_because_there_is_one() {
    let (_folder, packed) = Packed::still();
    let mut messages = packed.messages(Wire::Cdr, Pixels::Mono8);
    let right: Vec<Message> = messages
        .iter()
        .filter(|message| message.topic == pack::IMAGE_TOPIC)
        .map(|message| Message { topic: "/cam1/image_raw", bytes: message.bytes.clone(), ..*message })
        .collect();
    messages.extend(right.into_iter().take(6));
    messages.push(Message { nanos: 1, topic: "/chatter", kind: "std_msgs/String", bytes: vec![0, 1, 0, 0, 1, 0, 0, 0, 0] });
    messages.sort_by_key(|message| message.nanos);
    let path = packed.path("topics.mcap");
    pack::mcap(&path, &messages, Wire::Cdr, Some(4096));

    let images = |image: &str, imu: &str| Hints { image_topic: Some(image.into()), imu_topic: Some(imu.into()), ..packed.hints() };
    assert_eq!(open(&path, &images("/cam1/image_raw", "/imu0")).unwrap().listed_frames, 6);
    assert_eq!(open(&path, &images("/cam0/image_raw", "/imu0")).unwrap().listed_frames, 10);
    // Kalibr's chain names one of the two.
    let told = kalibr();
    let hints = Hints { calibration: Some(told.path().to_path_buf()), ..Hints::default() };
    assert_eq!(open(&path, &hints).unwrap().listed_frames, 10);

    for (hints, words) in [
        (packed.hints(), ["2 topics", "`/cam1/image_raw`"]),
        (images("/cam7", "/imu0"), ["no topic `/cam7`", "`/cam0/image_raw`, `/cam1/image_raw`"]),
        (images("/cam0/image_raw", "/chatter"), ["`/chatter`", "std_msgs/msg/String"]),
        (images("/imu0", "/imu0"), ["`/imu0`", "--image-topic"]),
    ] {
        let (kind, said) = refused(&path, &hints);
        assert!(kind == FaultKind::Configuration && words.iter().all(|word| said.contains(word)), "{said}");
    }
    let (folder, _) = Packed::still();
    assert!(refused(folder.root(), &images("/cam0", "/imu0")).1.contains("no topics"));
    // A recording without a camera.
    messages.retain(|message| !message.topic.starts_with("/cam"));
    pack::mcap(&path, &messages, Wire::Cdr, Some(4096));
    let (kind, said) = refused(&path, &packed.hints());
    assert!(kind == FaultKind::Malformed && said.contains("sensor_msgs/Image") && said.contains("`/chatter`"), "{said}");
}

#[test]
fn a_bag_without_calibration_says_what_to_put_where() {
    let (_folder, packed) = Packed::still();
    for path in [packed.bag(Packing::None), packed.mcap(Wire::Cdr)] {
        let (kind, said) = refused(&path, &Hints::default());
        assert!(kind == FaultKind::Missing && said.contains("calibration") && said.contains("--calibration"), "{said}");
    }
    let nowhere = Hints { calibration: Some(packed.path("nowhere")), ..Hints::default() };
    assert!(refused(&packed.bag(Packing::None), &nowhere).1.contains("nowhere"));
    let empty = Hints { calibration: Some(packed.temporary.path().to_path_buf()), ..Hints::default() };
    assert!(refused(&packed.bag(Packing::None), &empty).1.contains("holds no calibration"));
    // A chain alone knows nothing of the noise.
    std::fs::write(packed.path("camchain.yaml"), CHAIN).unwrap();
    assert!(refused(&packed.bag(Packing::None), &empty).1.contains("imu.yaml"));
}

/// Every length that a file may have been cut off at, in steps that are no multiple of anything.
fn cuts(whole: &[u8]) -> impl Iterator<Item = usize> {
    let length = whole.len();
    (0..40).chain((40..length).step_by(length / 97 + 1)).chain(length.saturating_sub(40)..length)
}

#[test]
fn files_that_are_cut_off_are_refused_in_one_sentence() {
    let (_folder, packed) = Packed::still();
    for path in [packed.zip(), packed.bag(Packing::Lz4), packed.mcap(Wire::Cdr)] {
        let whole = std::fs::read(&path).unwrap();
        let cut = packed.path("cut");
        for length in cuts(&whole) {
            std::fs::write(&cut, &whole[..length]).unwrap();
            let (kind, said) = refused(&cut, &packed.hints());
            assert!(kind == FaultKind::Malformed, "{length} bytes of {}: {said}", path.display());
        }
    }
}

/// Nothing that a byte can be changed into ends the program, hangs it, or makes it take gigabytes: it is refused, or read.
#[test]
fn damaged_bytes_do_no_harm() {
    let (_folder, packed) = Packed::still();
    let hints = packed.hints();
    let config = Config::default();
    for (path, hints) in [(packed.zip(), &Hints::default()), (packed.bag(Packing::Bz2), &hints), (packed.mcap(Wire::Cdr), &hints)] {
        let whole = std::fs::read(&path).unwrap();
        let step = whole.len() / 151 + 1;
        for index in (0..whole.len()).step_by(step).chain(0..64).chain(whole.len() - 64..whole.len()) {
            for value in [0, 0xff, whole[index] ^ 0x10] {
                let mut bytes = whole.clone();
                bytes[index] = value;
                std::fs::write(&path, bytes).unwrap();
                match dataset::open_with(&path, &config.dataset, hints) {
                    Ok(recording) => drop(recording.events(2).unwrap().count()),
                    Err(fault) => assert!(!fault.to_string().contains('\n'), "{fault}"),
                }
            }
        }
        std::fs::write(&path, whole).unwrap();
    }
}

/// Adds entries to a whole archive.
fn zip_with(packed: &Packed, entries: &[(&str, &[u8])]) -> PathBuf {
    let path = packed.zip();
    let file = std::fs::OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let mut writer = zip::ZipWriter::new_append(file).unwrap();
    for (name, bytes) in entries {
        writer.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap();
    path
}

#[test]
fn archives_with_names_that_leave_their_folder_are_refused() {
    let (_folder, packed) = Packed::still();
    for name in ["../escape.txt", "mav0/../../escape.txt", "/etc/escape.txt", "C:/escape.txt", "mav0\\..\\escape.txt"] {
        let (kind, said) = refused(&zip_with(&packed, &[(name, b"x")]), &Hints::default());
        assert!(kind == FaultKind::Malformed && said.contains("leaves its folder"), "{name}: {said}");
    }
    // Dots within a name are none of that.
    open(&zip_with(&packed, &[("mav0/notes..txt", b"x")]), &Hints::default()).unwrap();
}

#[test]
fn archives_that_unpack_to_too_much_are_stopped() {
    let (folder, packed) = Packed::still();
    // An image of 65 MB of zeros, of which its archive needs 65 kB.
    std::fs::write(folder.image(4), vec![0; 65 << 20]).unwrap();
    let path = packed.path("bomb.zip");
    let mut writer = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    for (name, file) in [("cam0/sensor.yaml", folder.path("cam0/sensor.yaml")), ("imu0/sensor.yaml", folder.path("imu0/sensor.yaml"))] {
        writer.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(&std::fs::read(file).unwrap()).unwrap();
    }
    for name in ["cam0/data.csv", "imu0/data.csv"] {
        writer.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(&std::fs::read(folder.path(name)).unwrap()).unwrap();
    }
    for index in 0..10 {
        let name = folder.image(index).file_name().unwrap().to_string_lossy().into_owned();
        writer.start_file(format!("cam0/data/{name}"), zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(&std::fs::read(folder.image(index)).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() < 1 << 20);
    let recording = open(&path, &Hints::default()).unwrap();
    let images = recording.events(1).unwrap().filter_map(|event| match event {
        Event::Image { image, .. } => Some(image),
        _ => None,
    });
    let faults: Vec<_> = images.enumerate().filter_map(|(index, image)| Some((index, image.err()?.to_string()))).collect();
    assert!(faults.len() == 1 && faults[0].0 == 4 && faults[0].1.contains("64 MB"), "{faults:?}");
}

/// A chunk that says it unpacks to 4 GB, and one that unpacks to more than it says.
#[test]
fn chunks_that_unpack_to_too_much_are_stopped() {
    let (_folder, packed) = Packed::still();
    let path = packed.bag(Packing::Lz4);
    let whole = std::fs::read(&path).unwrap();
    let at = whole.windows(5).position(|window| window == b"size=").unwrap() + 5;
    for (size, word) in [(u32::MAX, "4095 MB"), (100, "100 bytes")] {
        let mut bytes = whole.clone();
        bytes[at..at + 4].copy_from_slice(&size.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let (kind, said) = refused(&path, &packed.hints());
        assert!(kind == FaultKind::Malformed && said.contains(word), "{said}");
    }
}

#[test]
fn files_of_other_kinds_are_named_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    for (bytes, word) in [
        (&b"SQLite format 3\0 and more"[..], "ros2 bag convert"),
        (b"#ROSBAG V1.2\n and more", "2.0"),
        (b"PK\x05\x06\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", "empty"),
        (b"\x1f\x8b\x08 and more than that", "unpack"),
        (b"some text that is no recording", "neither"),
        (b"", "0 bytes"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        assert!(refused(&path, &Hints::default()).1.contains(word));
    }
    let bag = folder.path().join("ros2");
    std::fs::create_dir(&bag).unwrap();
    std::fs::write(bag.join("metadata.yaml"), "").unwrap();
    assert!(refused(&bag, &Hints::default()).1.contains("without its MCAP files"));
    std::fs::write(bag.join("x_0.db3"), "").unwrap();
    assert!(refused(&bag, &Hints::default()).1.contains("sqlite3"));
    // A bag whose recorder was stopped has no index yet.
    let (_folder, packed) = Packed::still();
    let path = packed.bag(Packing::None);
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(10).position(|window| window == b"index_pos=").unwrap() + 10;
    bytes[at..at + 8].fill(0);
    std::fs::write(&path, bytes).unwrap();
    assert!(refused(&path, &packed.hints()).1.contains("rosbag reindex"));
}

#[test]
fn archives_of_archives_and_of_several_recordings_are_not_guessed_at() {
    let (_folder, packed) = Packed::still();
    let path = packed.path("several.zip");
    let mut writer = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    for name in ["machine_hall/MH_01_easy/MH_01_easy.zip", "machine_hall/MH_01_easy/MH_01_easy.bag"] {
        writer.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
    }
    writer.finish().unwrap();
    assert!(refused(&path, &Hints::default()).1.contains("unpack it"));
    let mut writer = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    for name in ["V1_01_easy", "V1_02_medium"] {
        writer.start_file(format!("{name}/mav0/imu0/data.csv"), zip::write::SimpleFileOptions::default()).unwrap();
    }
    writer.finish().unwrap();
    assert!(refused(&path, &Hints::default()).1.contains("2 recordings"));
}

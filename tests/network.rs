//! Networks in ONNX files: the same numbers as PyTorch, the right pixels, and one clear sentence for every file that does not fit.

use std::fs;
use std::path::{Path, PathBuf};

use libella_core::camera::{Camera as _, CameraModel, KannalaBrandt};
use libella_core::image::ImageView;
use libella_core::time::Timestamp;
use libella_host::calibration::Rig;
use libella_host::network::{DepthKind, DepthMap, DepthNetwork, ModelCard, ModelChoice, NetworkError, OnnxNetwork, RecordedDepth};
use nalgebra::Vector2;

const SOME_TIME: Timestamp = Timestamp::from_nanos(1_403_715_273_262_142_976);

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("host/models")
}

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/network")
}

fn euroc() -> CameraModel<f64> {
    Rig::euroc().camera
}

/// As `golden/network/make.py` makes it.
fn made_up_image() -> Vec<u8> {
    let value = |x: u32, y: u32| (x / 4 + y / 3 + (x * x / 64) % 32 + ((x / 40) * 29 + (y / 32) * 53) % 97) % 256;
    (0..192).flat_map(|y| (0..320).map(move |x| u8::try_from(value(x, y)).unwrap())).collect()
}

fn predict(network: &mut OnnxNetwork, pixels: &[u8], [width, height]: [usize; 2]) -> Result<DepthMap, NetworkError> {
    network.predict(SOME_TIME, &ImageView::new(pixels, width, height, width).unwrap())
}

#[test]
fn tract_agrees_with_pytorch() {
    for name in ["indoor", "euroc"] {
        let path = models().join(format!("{name}.onnx"));
        let card = ModelCard::read(&path.with_extension("toml")).unwrap();
        // At the size of the input nothing is resampled.
        let mut network = OnnxNetwork::open(&path, &card.input.camera([320, 192])).unwrap();
        assert!(network.resampling().is_same_camera());
        let map = predict(&mut network, &made_up_image(), [320, 192]).unwrap();
        assert_eq!((map.width, map.height, map.step_px, map.origin_px, map.kind), (80, 48, [4.0; 2], [1.5; 2], DepthKind::Metric));
        let bytes = fs::read(golden().join(format!("{name}.f32"))).unwrap();
        let expected: Vec<f32> = bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        assert_eq!(expected.len(), 2 * 80 * 48);
        let worst = |got: &[f32], expected: &[f32]| got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let (depth, u) = expected.split_at(80 * 48);
        let off = [worst(&map.inverse_depth_1_m, depth), worst(&map.uncertainty, u)];
        println!("{name}: tract and PyTorch differ by {off:?}");
        assert!(off.iter().all(|off| *off < 1e-4), "{name}: {off:?}");
        let factor = card.sigma_per_u.unwrap() as f32;
        assert!(map.sigma_log.iter().zip(&map.uncertainty).all(|(sigma, u)| (sigma - factor * u).abs() < 1e-6));
    }
}

#[test]
fn the_same_image_gives_the_same_bits() {
    let image = made_up_image();
    let bits = |map: &DepthMap| -> Vec<u32> {
        [&map.inverse_depth_1_m, &map.sigma_log, &map.uncertainty].into_iter().flatten().map(|value| value.to_bits()).collect()
    };
    let path = models().join("indoor.onnx");
    let card = ModelCard::read(&path.with_extension("toml")).unwrap();
    let camera = card.input.camera([320, 192]);
    let mut one = OnnxNetwork::open(&path, &camera).unwrap();
    let first = bits(&predict(&mut one, &image, [320, 192]).unwrap());
    let other: Vec<u8> = image.iter().map(|pixel| 255 - pixel).collect();
    assert_ne!(bits(&predict(&mut one, &other, [320, 192]).unwrap()), first);
    assert_eq!(bits(&predict(&mut one, &image, [320, 192]).unwrap()), first);
    let mut again = OnnxNetwork::open(&path, &camera).unwrap();
    assert_eq!(bits(&predict(&mut again, &image, [320, 192]).unwrap()), first, "another instance");
}

#[test]
fn the_names_on_the_command_line_open_the_shipped_networks() {
    let open = |name: &str| name.parse::<ModelChoice>().unwrap().open(&euroc(), None);
    assert!(open("none").unwrap().is_none());
    for name in ["indoor", "euroc"] {
        let mut network = open(name).unwrap().unwrap();
        assert_eq!(network.describe(), format!("{name}.onnx, 320x192 to 80x48, tract"));
        let map = network.predict(SOME_TIME, &ImageView::new(&[99; 752 * 480], 752, 480, 752).unwrap()).unwrap();
        assert_eq!((map.width, map.height, map.step_px, map.origin_px), (80, 48, [9.4, 10.0], [4.2, 4.5]));
        assert!(map.known_share() > 0.999);
    }
    let absent = open("absent.onnx").err().unwrap().to_string();
    assert_eq!(absent, "absent.onnx: there is no such file; give an ONNX file, or one of indoor, euroc, none");
}

/// A small model of `golden/network` in a folder of its own, with a card.
struct Small {
    folder: tempfile::TempDir,
}

impl Small {
    const CARD: &str = "sigma_log = 0.2\n[input]\nname = \"image\"\nnormalised_intrinsics = [0.7, 1.05, 0.5, 0.5]\n[depth]\nname = \"depth\"\nkind = \"inverse\"\n";

    fn new(model: &[u8], card: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("m.onnx"), model).unwrap();
        fs::write(folder.path().join("m.toml"), card).unwrap();
        Self { folder }
    }

    fn golden(name: &str, card: &str) -> Self {
        Self::new(&fs::read(golden().join(format!("{name}.onnx"))).unwrap(), card)
    }

    fn camera() -> CameraModel<f64> {
        ModelCard::parse(Self::CARD, Path::new("m.toml")).unwrap().input.camera([48, 32])
    }

    fn open(&self) -> Result<OnnxNetwork, String> {
        let path = self.folder.path().join("m.onnx");
        OnnxNetwork::open(&path, &Self::camera()).map_err(|fault| {
            let text = fault.to_string();
            assert_eq!(text.lines().count(), 1, "{text}");
            assert!(text.len() < 600, "{text}");
            text
        })
    }
}

#[test]
fn depth_of_a_fisheye_lies_at_its_pixels() {
    // The network gives the mean grey of 4 x 4 pixels, as inverse depth; the image is a slope in the angle to the axis.
    let small = Small::golden("mean", Small::CARD);
    let fisheye: CameraModel<f64> =
        KannalaBrandt::new((320, 300), [150.0, 150.0], [158.0, 151.0], [0.01, -0.003, 0.0, 0.0]).unwrap().into();
    let slope = |x: f64, y: f64| {
        let bearing = fisheye.unproject(&Vector2::new(x, y)).unwrap();
        128.0 + 100.0 * (0.8 * bearing.x.atan2(bearing.z) - 0.6 * bearing.y.atan2(bearing.z))
    };
    let pixels: Vec<u8> = (0..300)
        .flat_map(|y| (0..320).map(move |x| [f64::from(x), f64::from(y)]))
        .map(|[x, y]| slope(x, y).round().clamp(0.0, 255.0) as u8)
        .collect();
    let mut network = OnnxNetwork::open(&small.folder.path().join("m.onnx"), &fisheye).unwrap();
    assert!(!network.resampling().is_same_camera());
    let map = network.predict(SOME_TIME, &ImageView::new(&pixels, 320, 300, 320).unwrap()).unwrap();
    let mut checked = 0;
    // Away from the rims of what the network sees, where the outermost values are repeated.
    for y in (115..191).step_by(3) {
        for x in (115..206).step_by(3) {
            let [x, y] = [f64::from(x), f64::from(y)];
            let Some(sample) = map.sample([x, y]) else { continue };
            // Half a level is a pixel of the fisheye; an output pixel is 18 of them.
            let off = f64::from(sample.inverse_depth_1_m) * 255.0 - slope(x, y);
            assert!(off.abs() < 0.5, "{off} levels off at {x} {y}");
            assert!((sample.sigma_log - 0.2).abs() < 1e-6);
            checked += 1;
        }
    }
    assert!(checked > 500, "{checked}");
    // Far to the side the network's camera sees nothing.
    assert!(map.sample([5.0, 150.0]).is_none());
}

#[test]
fn a_model_may_give_depth_or_relative_depth_with_or_without_uncertainty() {
    let image: Vec<u8> = (0..48 * 32).map(|k| u8::try_from(k / 48 / 4 * 30 + 20).unwrap()).collect();
    let map = |model: &str, card: &str| predict(&mut Small::golden(model, card).open().unwrap(), &image, [48, 32]).unwrap();
    let inverse = map("mean", Small::CARD);
    let means: Vec<f32> = (0..96).map(|k| (k / 12 * 30 + 20) as f32 / 255.0).collect();
    assert!(inverse.inverse_depth_1_m.iter().zip(&means).all(|(a, b)| (a - b).abs() < 1e-6));
    assert!(
        inverse.sigma_log.iter().all(|sigma| (sigma - 0.2).abs() < 1e-6)
            && inverse.uncertainty.iter().all(|u| (u - 0.2 / 2_f32.sqrt()).abs() < 1e-6)
    );
    let depth = map("mean", &Small::CARD.replace("\"inverse\"", "\"depth\""));
    assert!(depth.inverse_depth_1_m.iter().zip(&means).all(|(a, b)| (a * b - 1.0).abs() < 1e-5) && depth.kind == DepthKind::Metric);
    assert_eq!(map("mean", &Small::CARD.replace("\"inverse\"", "\"inverse\"\nmetric = false")).kind, DepthKind::UpToScale);
    assert_eq!(map("mean", &Small::CARD.replace("\"inverse\"", "\"relative\"")).kind, DepthKind::Affine);
    // With uncertainty; it is the sigmoid of the depth here.
    let card = format!("{}[uncertainty]\nname = \"u\"\n", Small::CARD.replace("sigma_log = 0.2", "sigma_per_u = 0.5"));
    let both = map("both", &card);
    for ((u, sigma), mean) in both.uncertainty.iter().zip(&both.sigma_log).zip(&means) {
        assert!((u - 1.0 / (1.0 + (-mean).exp())).abs() < 1e-4 && (sigma - 0.5 * u).abs() < 1e-6);
    }
    // A second output that the card does not name is not asked for.
    assert_eq!(map("both", Small::CARD), inverse);
    // No depth where the network says zero.
    let black = predict(&mut Small::golden("mean", Small::CARD).open().unwrap(), &[0; 48 * 32], [48, 32]).unwrap();
    assert!(black.known_share() < 1e-9);
}

#[test]
fn every_file_that_does_not_fit_is_told_in_one_sentence() {
    let uncertain = format!("{}[uncertainty]\nname = \"u\"\n", Small::CARD.replace("sigma_log", "sigma_per_u"));
    let renamed = |from: &str, to: &str| Small::CARD.replace(&format!("name = \"{from}\""), &format!("name = \"{to}\""));
    for (model, card, said) in [
        ("double", Small::CARD, "input `image` is of type double, not f32"),
        ("colour", Small::CARD, "input `image` has the shape 1 x 3 x 32 x 48, not 1 x 1 x height x width"),
        ("unsized", Small::CARD, "input `image` has the shape 1 x 1 x ? x ?, not 1 x 1 x height x width"),
        ("opset22", Small::CARD, "operator set 22, not one of 9 to 18"),
        ("opset7", Small::CARD, "operator set 7, not one of 9 to 18"),
        ("flat", Small::CARD, "output `depth` has the shape"),
        ("unknown_operator", Small::CARD, "Telepathy"),
        ("loop", Small::CARD, "is no ONNX file that can be used"),
        ("external", Small::CARD, "keeps its tensor `offset` in another file"),
        ("huge", Small::CARD, "numbers at once"),
        ("uneven", &uncertain, "outputs `depth` and `u` differ in size"),
        ("mean", &uncertain, "has no output `u` but `depth`"),
        ("mean", &renamed("depth", "deep"), "has no output `deep` but `depth`"),
        ("mean", &renamed("image", "picture"), "has no input `picture` but `image`"),
        ("mean", "", "is no description of a network"),
        ("mean", &format!("file = \"../m.onnx\"\n{}", Small::CARD), "leads out of the folder"),
    ] {
        let error = Small::golden(model, card).open().err().unwrap_or_else(|| format!("{model} was taken"));
        assert!(error.contains(said), "{model}: {error}");
    }
    for (bytes, said) in [(b"".as_slice(), "graph"), (b"not a network", "is no ONNX file that can be used")] {
        let error = Small::new(bytes, Small::CARD).open().err().unwrap();
        assert!(error.contains(said), "{error}");
    }
    let small = Small::golden("mean", Small::CARD);
    fs::remove_file(small.folder.path().join("m.toml")).unwrap();
    assert!(small.open().err().unwrap().contains("m.toml: there is no such file"));
    // A card can be given instead of the file, and name it.
    let small = Small::golden("mean", &format!("file = \"other.onnx\"\n{}", Small::CARD));
    fs::rename(small.folder.path().join("m.onnx"), small.folder.path().join("other.onnx")).unwrap();
    OnnxNetwork::open(&small.folder.path().join("m.toml"), &Small::camera()).unwrap();
    // Too large a file is not even read: this one is a hole of 65 MiB.
    let small = Small::new(b"", Small::CARD);
    fs::File::options().write(true).open(small.folder.path().join("m.onnx")).unwrap().set_len(65 << 20).unwrap();
    assert!(small.open().err().unwrap().contains("has 65.0 MiB, more than 64 MiB"));
    assert!(OnnxNetwork::open(&golden(), &Small::camera()).unwrap_err().to_string().contains("is no file"));
}

#[test]
fn numbers_that_are_not_finite_are_refused_and_the_next_image_is_not() {
    let mut network = Small::golden("not_finite", Small::CARD).open().unwrap();
    // The logarithm of black.
    let error = predict(&mut network, &[0; 48 * 32], [48, 32]).unwrap_err();
    assert_eq!(error.to_string(), "the network's `depth` has 96 of 96 values that are not finite");
    assert!(predict(&mut network, &[200; 48 * 32], [48, 32]).is_ok());
    let size = predict(&mut network, &[0; 32 * 48], [32, 48]).unwrap_err();
    assert_eq!(size.to_string(), "the image has 32x48 pixels and the camera 48x32");
    // Twice the grey as uncertainty.
    let card = format!("{}[uncertainty]\nname = \"u\"\n", Small::CARD.replace("sigma_log", "sigma_per_u"));
    let mut network = Small::golden("twice", &card).open().unwrap();
    let error = predict(&mut network, &[204; 48 * 32], [48, 32]).unwrap_err();
    assert!(matches!(&error, NetworkError::Uncertainty { output, value } if output == "u" && (value - 1.6).abs() < 1e-6), "{error}");
    assert!(predict(&mut network, &[100; 48 * 32], [48, 32]).is_ok());
}

/// A damaged file is refused, or gives a network that runs or says why not; nothing panics, hangs or takes all memory.
fn damaged(bytes: &[u8], card: &ModelCard, camera: &CameraModel<f64>, image: &[u8], size: [usize; 2]) -> bool {
    match OnnxNetwork::from_bytes(bytes, Path::new("m.onnx"), card, camera) {
        Ok(mut network) => {
            if let Ok(map) = predict(&mut network, image, size) {
                assert!(map.inverse_depth_1_m.iter().all(|value| value.is_finite()));
            }
            true
        }
        Err(fault) => {
            let text = fault.to_string();
            assert!(text.starts_with("m.onnx: ") && text.lines().count() == 1 && text.len() < 600, "{text}");
            false
        }
    }
}

#[test]
fn no_damage_of_a_small_file_is_a_panic() {
    let card = format!("{}[uncertainty]\nname = \"u\"\n", Small::CARD.replace("sigma_log", "sigma_per_u"));
    let card = ModelCard::parse(&card, Path::new("m.toml")).unwrap();
    let good = fs::read(golden().join("both.onnx")).unwrap();
    let image: Vec<u8> = (0..48 * 32).map(|k| u8::try_from(k % 256).unwrap()).collect();
    let taken = |bytes: &[u8]| damaged(bytes, &card, &Small::camera(), &image, [48, 32]);
    assert!(taken(&good));
    let mut refused = 0;
    for length in 0..good.len() {
        refused += usize::from(!taken(&good[..length]));
    }
    for bit in 0..8 * good.len() {
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        refused += usize::from(!taken(&bytes));
    }
    println!("{refused} of {} damaged files refused", 9 * good.len());
    // Names of nodes may change and shapes of outputs are not needed: most damage, not all, is noticed.
    assert!(refused > 9 * good.len() / 2, "{refused}");
}

#[test]
fn no_damage_of_a_shipped_file_is_a_panic() {
    let path = models().join("indoor.onnx");
    let card = ModelCard::read(&path.with_extension("toml")).unwrap();
    let camera = card.input.camera([320, 192]);
    let image = made_up_image();
    let good = fs::read(path).unwrap();
    let mut state = 1_u64;
    let mut draw = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut refused = 0;
    // The head of the file holds the graph; weights fill the rest.
    for round in 0..40 {
        let mut bytes = good.clone();
        let place = if round % 2 == 0 { draw(20_000) } else { draw(bytes.len()) };
        if round % 4 < 3 {
            bytes[place] ^= 1 << draw(8)
        } else {
            bytes.truncate(place)
        }
        refused += usize::from(!damaged(&bytes, &card, &camera, &image, [320, 192]));
    }
    println!("{refused} of 40 damaged files refused");
    assert!(refused >= 10, "{refused}: cut files alone are 10");
}

#[test]
fn stored_maps_are_replayed_in_their_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let below = folder.path().join("mav0/cam0/depth");
    fs::create_dir_all(&below).unwrap();
    let (width, height) = (64_u32, 48_u32);
    // Millimetres; a column without depth.
    let depth = |x: u32, y: u32| if x == 20 { 0 } else { u16::try_from(1000 + 10 * x + y).unwrap() };
    image::ImageBuffer::from_fn(width, height, |x, y| image::Luma([depth(x, y)])).save(below.join("5000.png")).unwrap();
    image::ImageBuffer::from_fn(width, height, |_, _| image::Luma([7_u8])).save(below.join("6000.png")).unwrap();
    fs::write(below.join("7000.png"), b"no picture").unwrap();
    for (stride, known) in [(1, 63.0 / 64.0), (4, 1.0), (8, 7.0 / 8.0)] {
        let mut network = RecordedDepth::open(folder.path(), stride).unwrap();
        let grey = vec![0; 64 * 48];
        let view = ImageView::new(&grey, 64, 48, 64).unwrap();
        let map = network.predict(Timestamp::from_nanos(5000), &view).unwrap();
        assert!((map.known_share() - known).abs() < 1e-9, "{stride}: {}", map.known_share());
        // At its own pixels the map is exact.
        for index in (0..map.width * map.height).filter(|index| map.is_known(*index)) {
            let (i, j) = ((index % map.width) as f64, (index / map.width) as f64);
            let [x, y] = [map.origin_px[0] + i * map.step_px[0], map.origin_px[1] + j * map.step_px[1]];
            let expected = 1000.0 / f64::from(depth(x as u32, y as u32));
            assert!((f64::from(map.inverse_depth_1_m[index]) - expected).abs() < 1e-6, "{x} {y}");
        }
        for (stamp, said) in [(4000, "there is no depth map of this image"), (6000, "is no 16-bit grey image"), (7000, "cannot be decoded")]
        {
            let error = network.predict(Timestamp::from_nanos(stamp), &view).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains(&format!("{stamp}.png")) && error.lines().count() == 1, "{error}");
        }
        let small = ImageView::new(&grey, 32, 48, 64).unwrap();
        assert!(matches!(network.predict(Timestamp::from_nanos(5000), &small), Err(NetworkError::ImageSize { .. })));
    }
    assert!(RecordedDepth::open(&below, 1).is_ok());
    assert!(RecordedDepth::open(&golden(), 1).unwrap_err().to_string().contains("holds no depth maps"));
}

/// Milliseconds per image of 752 x 480: `cargo test --release --test system network::speed -- --ignored --nocapture`.
#[test]
#[ignore = "a figure, not a check"]
fn speed() {
    let pixels: Vec<u8> = (0..752 * 480).map(|k: u32| ((k % 752) / 3 + k / 752 / 2) as u8).collect();
    for name in ["indoor", "euroc"] {
        let mut network = OnnxNetwork::open(&models().join(format!("{name}.onnx")), &euroc()).unwrap();
        let mut ms: Vec<f64> = (0..33)
            .map(|_| {
                let begun = std::time::Instant::now();
                predict(&mut network, &pixels, [752, 480]).unwrap();
                begun.elapsed().as_secs_f64() * 1e3
            })
            .skip(3)
            .collect();
        ms.sort_by(f64::total_cmp);
        println!("{name}: median {:.1} ms of 30, least {:.1}, most {:.1}", ms[15], ms[0], ms[29]);
    }
}

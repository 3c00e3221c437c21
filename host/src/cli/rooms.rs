//! `libella rooms`

use std::fs::File;
use std::io::{BufWriter, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use libella_host::fault::{Fault, FaultKind};
use libella_host::sim::{self, RoomView, RoomsConfig, SimError};

use super::run::{progress, stop_on_interrupt};
use super::simulate::{unusable, unwritable};
use super::{Exit, say};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder for `images.npy`, `depth_m.npy` and `views.npy`; it must not hold them already.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// How many rooms.
    #[arg(long, default_value_t = 10)]
    rooms: u64,
    /// Views of each room, 1 to 10000.
    #[arg(long, default_value_t = 24)]
    views: usize,
    /// Seed of the first room; the others follow.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Share of rooms that are furnished as those of flights, 0 to 1.
    #[arg(long, default_value_t = RoomsConfig::default().flight_share, allow_negative_numbers = true)]
    flights: f64,
    /// Varies focal length and distortion by room, instead of EuRoC's camera as it is.
    #[arg(long)]
    varied_camera: bool,
    /// Threads, 1 to 256; all cores if not given.
    #[arg(long)]
    threads: Option<usize>,
    /// Prints nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let usual = RoomsConfig::default();
    let config = RoomsConfig {
        views: arguments.views,
        flight_share: arguments.flights,
        varied_camera: arguments.varied_camera,
        threads: arguments.threads.unwrap_or(usual.threads),
        ..usual
    };
    config.check().map_err(unusable)?;
    if arguments.out.join("images.npy").exists() {
        let remedy = "give another folder with --out, or delete it";
        return Err(Fault::new(FaultKind::Output, "holds views already", remedy).at(&arguments.out));
    }
    let stop = stop_on_interrupt();
    let [width, height] = config.size_px.map(|side| side as usize);
    let stride = config.stride as usize;
    std::fs::create_dir_all(&arguments.out).map_err(|error| file(&arguments.out, &error))?;
    let mut images = Npy::create(&arguments.out.join("images.npy"), "|u1", &[height, width])?;
    let mut depths = Npy::create(&arguments.out.join("depth_m.npy"), "<f4", &[height / stride, width / stride])?;
    let mut views = Npy::create(&arguments.out.join("views.npy"), "<f8", &[12])?;
    #[allow(clippy::cast_possible_truncation)]
    let bar = progress(arguments.rooms as usize * config.views, arguments.quiet);
    let mut interrupted = false;
    for seed in (arguments.seed..).take_while(|seed| *seed - arguments.seed < arguments.rooms) {
        interrupted = stop.load(Ordering::Relaxed);
        if interrupted {
            break;
        }
        let mut written = Ok(());
        sim::room_views(&config, seed, |view| {
            if written.is_ok() {
                written = write(&view, seed, &mut images, &mut depths, &mut views);
            }
            bar.inc(1);
        })
        .map_err(unusable)?;
        written?;
    }
    let count = views.rows;
    images.finish()?;
    depths.finish()?;
    views.finish()?;
    bar.finish_and_clear();
    if interrupted {
        eprintln!("libella: interrupted after {count} views; what is written can be read");
        return Ok(Exit::Interrupted);
    }
    if !arguments.quiet {
        let seconds = bar.elapsed().as_secs_f64();
        say(&format!("views           {}\n{count} of {} rooms in {seconds:.1} s\n", arguments.out.display(), arguments.rooms));
    }
    Ok(Exit::Done)
}

/// A row of each file. Columns of `views.npy`: seed, four normalised intrinsics, position (m) and quaternion w x y z of the camera.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss)]
fn write(view: &RoomView, seed: u64, images: &mut Npy, depths: &mut Npy, views: &mut Npy) -> Result<(), Fault> {
    images.row(&view.image.pixels)?;
    depths.row(&view.depth_m.iter().flat_map(|depth| (*depth as f32).to_le_bytes()).collect::<Vec<u8>>())?;
    let (position, rotation) = (view.world_from_camera.translation.vector, view.world_from_camera.rotation);
    let mut numbers = vec![seed as f64];
    numbers.extend(view.normalised_intrinsics);
    numbers.extend([position.x, position.y, position.z, rotation.w, rotation.i, rotation.j, rotation.k]);
    views.row(&numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>())
}

fn file(path: &Path, reason: &std::io::Error) -> Fault {
    unwritable(SimError::File { path: path.to_owned(), reason: reason.to_string() })
}

/// A numpy array that grows row by row.
struct Npy {
    path: PathBuf,
    out: BufWriter<File>,
    kind: &'static str,
    shape: Vec<usize>,
    rows: usize,
}

impl Npy {
    fn create(path: &Path, kind: &'static str, shape: &[usize]) -> Result<Self, Fault> {
        let out = BufWriter::new(File::create(path).map_err(|error| file(path, &error))?);
        let mut array = Self { path: path.to_owned(), out, kind, shape: shape.to_vec(), rows: 0 };
        array.head()?;
        Ok(array)
    }

    fn row(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        self.rows += 1;
        self.out.write_all(bytes).map_err(|error| file(&self.path, &error))
    }

    /// The head of format 1.0, padded to 128 bytes whatever the number of rows.
    fn head(&mut self) -> Result<(), Fault> {
        let shape = self.shape.iter().map(|side| format!(" {side},")).collect::<String>();
        let text = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({},{shape}), }}", self.kind, self.rows);
        let head = format!("{text:<117}\n");
        let bytes = [b"\x93NUMPY\x01\x00\x76\x00".as_slice(), head.as_bytes()].concat();
        self.out.write_all(&bytes).map_err(|error| file(&self.path, &error))
    }

    fn finish(mut self) -> Result<(), Fault> {
        self.out.rewind().map_err(|error| file(&self.path, &error))?;
        self.head()?;
        self.out.flush().map_err(|error| file(&self.path, &error))
    }
}

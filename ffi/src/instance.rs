//! An estimator of some profile in memory of the caller.

use libella_core::estimator::{Estimator, FrameOutcome, Health, InputError, PlaneKeeper, StateEstimate, StepBudget};
use libella_core::image::{ImageView, PyramidPair, pyramid_bytes};
use libella_core::imu::ImuSample;
use libella_core::profile::{Desktop, Micro, MicroPyramids, Mobile};
use libella_core::time::Timestamp;
use libella_core::track::{Observation, TrackId};
use nalgebra::Vector2;

use crate::convert;
use crate::types::{LibellaPlane, LibellaProfile, LibellaTrack};

/// Marks memory that `libella_init` has written.
pub const MAGIC: u32 = 0x6c69_6265;

/// What every instance begins with.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: u32,
    /// A `LibellaProfile`.
    pub profile: u32,
}

/// An estimator with the pyramids that it reads.
#[repr(C)]
#[derive(Debug)]
pub struct Instance<E, P, K> {
    /// Tells which instance it is.
    pub header: Header,
    /// The estimator.
    pub estimator: E,
    /// The images that it compares.
    pub pyramids: P,
    /// The planes of the room, where they are sought.
    pub planes: Option<K>,
    /// Time of the newest image.
    pub newest: Timestamp,
}

/// The instance of [`Micro`].
pub type MicroInstance = Instance<Micro, MicroPyramids, PlaneKeeper<f32, 4, 8, 48>>;
/// The instance of [`Mobile`].
pub type MobileInstance = Instance<Mobile, PyramidPair<{ pyramid_bytes(640, 480, 4) }>, PlaneKeeper<f32, 8, 12, 150>>;
/// The instance of [`Desktop`].
pub type DesktopInstance = Instance<Desktop<f32>, PyramidPair<{ pyramid_bytes(752, 480, 4) }>, PlaneKeeper<f32, 16, 12, 640>>;

/// The alignment that suffices for every instance.
pub const ALIGNMENT: usize = 16;
const _: () = assert!(align_of::<MicroInstance>() <= ALIGNMENT && align_of::<MobileInstance>() <= ALIGNMENT);
const _: () = assert!(align_of::<DesktopInstance>() <= ALIGNMENT);

/// The profile of a number, if it is one.
#[must_use]
pub fn profile(number: u32) -> Option<LibellaProfile> {
    [LibellaProfile::Micro, LibellaProfile::Mobile, LibellaProfile::Desktop].into_iter().find(|known| *known as u32 == number)
}

/// Bytes of an instance.
#[must_use]
pub fn bytes(profile: LibellaProfile) -> usize {
    match profile {
        LibellaProfile::Micro => size_of::<MicroInstance>(),
        LibellaProfile::Mobile => size_of::<MobileInstance>(),
        LibellaProfile::Desktop => size_of::<DesktopInstance>(),
    }
}

/// What can be asked of an instance of any profile.
pub trait Operate {
    /// One inertial sample.
    fn push_imu(&mut self, sample: ImuSample<f32>) -> Result<(), InputError>;
    /// One image.
    fn push_image(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<(), InputError>;
    /// The corners of one image; `None` when they are more than fit.
    fn push_tracks(&mut self, stamp: Timestamp, tracks: &[LibellaTrack]) -> Option<Result<(), InputError>>;
    /// Works on the newest image.
    fn step(&mut self, budget: StepBudget) -> FrameOutcome;
    /// The newest state.
    fn state(&self) -> Option<StateEstimate<f32>>;
    /// The planes fit for use, one after the other.
    fn planes(&self, take: &mut dyn FnMut(LibellaPlane));
    /// How it goes.
    fn health(&self) -> Health;
    /// Starts over.
    fn reset(&mut self);
}

impl<
    const FRAMES: usize,
    const PAIRS: usize,
    const POINTS: usize,
    const SAMPLES: usize,
    const BYTES: usize,
    const PLANES: usize,
    const CORNERS: usize,
    const SEEN: usize,
> Operate for Instance<Estimator<f32, FRAMES, PAIRS, POINTS, SAMPLES>, PyramidPair<BYTES>, PlaneKeeper<f32, PLANES, CORNERS, SEEN>>
{
    fn push_imu(&mut self, sample: ImuSample<f32>) -> Result<(), InputError> {
        self.estimator.push_imu(sample)
    }

    fn push_image(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<(), InputError> {
        self.estimator.push_image(stamp, image, &mut self.pyramids).inspect(|()| self.newest = stamp)
    }

    fn push_tracks(&mut self, stamp: Timestamp, tracks: &[LibellaTrack]) -> Option<Result<(), InputError>> {
        let mut observations = [Observation { track: TrackId(0), pixel: Vector2::new(0.0_f32, 0.0) }; POINTS];
        let observations = observations.get_mut(..tracks.len())?;
        for (observation, track) in observations.iter_mut().zip(tracks) {
            *observation = Observation { track: TrackId(track.id), pixel: Vector2::new(track.x_px, track.y_px) };
        }
        Some(self.estimator.push_tracks(stamp, observations).inspect(|()| self.newest = stamp))
    }

    fn step(&mut self, budget: StepBudget) -> FrameOutcome {
        let outcome = self.estimator.step(budget);
        if let Some(planes) = self.planes.as_mut().filter(|_| outcome != FrameOutcome::NoFrame) {
            let _ = planes.after_image(self.newest, outcome, &mut self.estimator);
        }
        outcome
    }

    fn planes(&self, take: &mut dyn FnMut(LibellaPlane)) {
        let steady = self.planes.iter().flat_map(PlaneKeeper::steady);
        steady.for_each(|(id, known)| take(convert::plane(id, known)));
    }

    fn state(&self) -> Option<StateEstimate<f32>> {
        self.estimator.state()
    }

    fn health(&self) -> Health {
        self.estimator.health()
    }

    fn reset(&mut self) {
        self.estimator.reset();
        if let Some(planes) = &mut self.planes {
            planes.forget();
        }
    }
}

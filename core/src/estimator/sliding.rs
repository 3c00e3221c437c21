//! Which frame leaves the window, and how.

use super::Estimator;
use crate::camera::Camera;
use crate::real::Real;
use crate::solve::marginalize_oldest;

/// Frames that always stay with what they see: the newest and those just before it.
pub(super) const RECENT: usize = 2;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Decides over the frame that is no longer recent, and makes room for the next image. Returns whether it stays.
    pub(super) fn slide(&mut self) -> bool {
        let Some(candidate) = self.window.frames.len().checked_sub(RECENT + 1) else { return false };
        let kept = self.window.frames[candidate].keyframe || self.is_keyframe(candidate);
        if kept {
            self.window.frames[candidate].keyframe = true;
            if self.window.frames.is_full() {
                self.retire_oldest(candidate + 1);
            }
        } else {
            self.drop_frame(candidate);
        }
        kept
    }

    /// Room for one frame in a full window, whatever it takes.
    pub(super) fn make_room(&mut self) {
        let keyframes = self.window.frames.iter().take_while(|frame| frame.keyframe).count().max(2);
        self.retire_oldest(keyframes);
    }

    fn retire_oldest(&mut self, keyframes: usize) {
        marginalize_oldest(&mut self.window, &mut self.prior, &mut self.workspace, &self.settings, keyframes);
        // The first prior has left its own origin behind by now.
        self.window.follow();
        self.report.marginalized = true;
    }

    fn is_keyframe(&self, candidate: usize) -> bool {
        let Some(last) = self.window.last_keyframe(candidate) else { return true };
        let seen = self.window.covisibility(last, candidate, &self.workspace.geometry.camera_poses);
        let parallax_px = seen.parallax * self.camera.focal_px();
        let few = T::of(0.5).max(self.config.keyframe_shared_ratio);
        #[allow(clippy::cast_precision_loss)]
        let shared_ratio = if seen.later > 0 { T::of(seen.shared as f64 / seen.later as f64) } else { T::one() };
        let span = (self.window.frames[candidate].stamp - self.window.frames[last].stamp).as_seconds::<T>();
        let threshold = self.config.keyframe_parallax_px;
        parallax_px > threshold || shared_ratio < few || (span > self.config.keyframe_interval_s && parallax_px > threshold * T::of(0.25))
    }

    /// Takes a frame out that is not worth keeping: its observations are dropped, its inertial samples go to the next frame.
    pub(super) fn drop_frame(&mut self, index: usize) {
        if index + 1 >= self.window.frames.len() {
            return;
        }
        if index > 0 {
            let (from, to) = (self.window.frames[index - 1].stamp, self.window.frames[index + 1].stamp);
            let joined = if self.inertial.covers(from, to) {
                self.inertial.integrate(&self.noise, self.window.frames[index - 1].state.bias, from, to)
            } else {
                let mut joined = self.window.frames[index].from_previous;
                joined.append(&self.window.frames[index + 1].from_previous);
                joined
            };
            self.window.frames[index + 1].from_previous = joined;
        }
        self.workspace.geometry.update_camera_poses(&self.window.frames, &self.settings);
        self.window.remove_frame(index, &self.workspace.geometry.camera_poses);
    }
}

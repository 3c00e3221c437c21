//! Where corners have been, for pictures.

use std::collections::{HashMap, VecDeque};

use libella_core::track::TrackId;

use super::View;

/// Images that a trail reaches back.
pub(crate) const TRAIL: usize = 11;

/// Where each corner of the last image was, oldest first, px.
#[derive(Debug, Default)]
pub(crate) struct Trails(HashMap<TrackId, VecDeque<[f64; 2]>>);

impl Trails {
    /// Takes in the next image; a corner that it does not see has no trail any more.
    pub(crate) fn follow(&mut self, view: &View) {
        let mut before = std::mem::take(&mut self.0);
        for corner in &view.corners {
            let mut trail = before.remove(&corner.track).unwrap_or_default();
            trail.push_back(corner.pixel);
            if trail.len() > TRAIL {
                trail.pop_front();
            }
            self.0.insert(corner.track, trail);
        }
    }

    /// The trail of a corner; the last place is where it is.
    pub(crate) fn of(&self, track: TrackId) -> Vec<[f64; 2]> {
        self.0.get(&track).map(|trail| trail.iter().copied().collect()).unwrap_or_default()
    }

    #[cfg(test)]
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

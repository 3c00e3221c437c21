//! Depth maps of one recording that all of its runs share: a network says the same of the same image every time.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use libella_core::camera::CameraModel;
use libella_core::image::ImageView;
use libella_core::time::Timestamp;

use crate::fault::Fault;
use crate::network::{DepthKind, DepthMap, DepthNetwork, ModelChoice, NetworkError};

/// What a source said of the images of one recording so far.
#[derive(Debug, Default)]
pub(super) struct Maps {
    by_stamp: Mutex<HashMap<i64, Result<DepthMap, NetworkError>>>,
    /// What the source is; known after it was opened once.
    about: Mutex<Option<(String, DepthKind)>>,
}

/// A source that asks only for what nobody has asked before.
pub(super) struct Stored {
    maps: Arc<Maps>,
    choice: ModelChoice,
    camera: CameraModel<f64>,
    recording: std::path::PathBuf,
    source: Option<Box<dyn DepthNetwork>>,
    about: (String, DepthKind),
}

impl Stored {
    /// `None` where no depth is wanted.
    ///
    /// # Errors
    /// When the source cannot be opened.
    pub fn open(maps: &Arc<Maps>, choice: &ModelChoice, camera: &CameraModel<f64>, recording: &Path) -> Result<Option<Self>, Fault> {
        let mut about = maps.about.lock().unwrap_or_else(PoisonError::into_inner);
        let mut source = None;
        if about.is_none() {
            let Some(opened) = choice.open(camera, Some(recording))? else { return Ok(None) };
            *about = Some((opened.describe(), opened.kind()));
            source = Some(opened);
        }
        let Some(about) = about.clone() else { return Ok(None) };
        Ok(Some(Self { maps: Arc::clone(maps), choice: choice.clone(), camera: *camera, recording: recording.into(), source, about }))
    }

    fn ask(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        if self.source.is_none() {
            self.source = self.choice.open(&self.camera, Some(&self.recording))?;
        }
        let Some(source) = &mut self.source else { return Err(NetworkError::Ended) };
        source.predict(stamp, image)
    }
}

impl DepthNetwork for Stored {
    fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        let known = |maps: &Maps| maps.by_stamp.lock().unwrap_or_else(PoisonError::into_inner).get(&stamp.as_nanos()).cloned();
        if let Some(map) = known(&self.maps) {
            return map;
        }
        // Two runs may ask at the same time; both get the same.
        let map = self.ask(stamp, image);
        self.maps.by_stamp.lock().unwrap_or_else(PoisonError::into_inner).insert(stamp.as_nanos(), map.clone());
        map
    }

    fn describe(&self) -> String {
        self.about.0.clone()
    }

    fn kind(&self) -> DepthKind {
        self.about.1
    }
}

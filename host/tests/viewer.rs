//! A run recorded for rerun, read back by rerun's own decoder.
#![cfg(feature = "rerun")]
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use libella_host::config::Config;
use libella_host::dataset::Recording;
use libella_host::eval::evaluate;
use libella_host::fault::FaultKind;
use libella_host::pipeline::{self, Run, Watch};
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight};
use libella_host::viewer::{Target, Viewer};
use re_log_encoding::DecoderApp;
use re_sdk::StoreKind;
use re_sdk::log::{Chunk, LogMsg};

fn flight(seconds: f64) -> Recording {
    let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: seconds, rest_s: 0.0, ..AnalyticConfig::default() };
    let source = MotionSource::Analytic(motion, ImuConfig::default());
    let flight = Arc::new(RenderedFlight::new(&source, &RenderConfig::default(), 2, 2).unwrap());
    pipeline::rendered_recording("a short flight", &flight).0
}

fn fly(recording: &Recording, viewer: &mut Viewer) -> Run {
    let watch = Watch { view: true, ..Watch::default() };
    let (run, _) = pipeline::run_with(recording, &Config::default(), None, watch, &AtomicBool::new(false), |frame, view| {
        viewer.add(frame, view.as_ref());
    })
    .unwrap();
    run
}

/// Rows of each entity of the recording, those that hold all the time apart; and messages of the arrangement.
fn rows(path: &Path) -> (BTreeMap<String, usize>, BTreeMap<String, usize>, usize) {
    let (mut over_time, mut always, mut arrangement) = (BTreeMap::new(), BTreeMap::new(), 0);
    for message in DecoderApp::decode_eager(BufReader::new(File::open(path).unwrap())).unwrap() {
        let message = message.unwrap();
        if message.store_id().kind() == StoreKind::Blueprint {
            arrangement += 1;
        } else if let LogMsg::ArrowMsg(_, arrow) = message {
            let chunk = Chunk::from_arrow_msg(&arrow).unwrap();
            let rows = if chunk.is_static() { &mut always } else { &mut over_time };
            *rows.entry(chunk.entity_path().to_string()).or_default() += chunk.num_rows();
        }
    }
    (over_time, always, arrangement)
}

#[test]
fn a_recorded_flight_holds_what_the_run_gave() {
    let (recording, config) = (flight(6.0), Config::default());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.rrd");
    let mut viewer = Viewer::open(&Target::File(path.clone()), &recording, false).unwrap();
    let run = fly(&recording, &mut viewer);
    let evaluation = evaluate(&run.trajectory(), recording.truth.as_ref().unwrap(), &config.evaluation).unwrap();
    viewer.finish(&recording, &config, &run, Some(&evaluation)).unwrap();

    let (over_time, always, arrangement) = rows(&path);
    let count = |entity: &str| over_time.get(entity).copied().unwrap_or(0);
    let (images, poses) = (run.frames.len(), run.poses().count());
    assert!(poses > 20 && images > poses, "{poses} of {images}");
    for entity in ["/world/camera/image/corners", "/world/camera/image/tracks", "/world/points", "/time_ms/solve", "/tracked"] {
        assert_eq!(count(entity), images, "{entity}");
    }
    // An image and its pinhole, which holds all the time.
    assert_eq!((count("/world/camera/image"), always["/world/camera/image"]), (images, 1));
    for entity in ["/world/camera", "/bias/gyro/x", "/bias/accel/z"] {
        assert_eq!(count(entity), poses, "{entity}");
    }
    let banded = run.poses().filter(|pose| pose.bias_sigma.is_some()).count();
    assert!(banded > 2);
    assert_eq!(count("/bias/gyro/x_band"), banded);
    assert_eq!(count("/error/position"), evaluation.matched_poses);
    assert_eq!(count("/world/trajectory"), poses / 10 + 1);
    assert_eq!((always["/world/truth"], always["/world"]), (1, 1));
    assert!(count("/health") >= 2 && count("/world/map") == 1 && arrangement > 10);
}

#[test]
fn what_cannot_be_recorded_ends_in_one_sentence() {
    let recording = flight(1.0);
    let opened = |target| Viewer::open(&target, &recording, false).map(|_| ()).unwrap_err();
    let folder = tempfile::tempdir().unwrap();
    let fault = opened(Target::File(folder.path().join("absent/flight.rrd")));
    assert!(fault.kind == FaultKind::Output && fault.to_string().contains("flight.rrd: cannot be written"), "{fault}");
    let fault = opened(Target::Connect("somewhere".into()));
    assert!(fault.kind == FaultKind::Configuration && fault.to_string().contains("is no address of a viewer"), "{fault}");
    // A port that nobody listens at.
    let fault = opened(Target::Connect("rerun+http://127.0.0.1:9/proxy".into()));
    assert!(fault.to_string().contains("no viewer answers") && !fault.to_string().contains('\n'), "{fault}");
}

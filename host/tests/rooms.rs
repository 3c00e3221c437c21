//! `libella rooms`, as a training script meets its files.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};

fn rooms(out: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_libella")).args(["rooms", "--quiet", "--out", out.to_str().unwrap()]).args(arguments).output().unwrap()
}

/// Head and data of a numpy file of format 1.0.
fn npy(path: &Path) -> (String, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    // The format asks for data that starts at a multiple of 64.
    assert_eq!((10 + length) % 64, 0);
    let head = String::from_utf8(bytes[10..10 + length].to_vec()).unwrap();
    assert!(head.ends_with('\n'));
    (head, bytes[10 + length..].to_vec())
}

#[test]
fn the_arrays_have_a_row_per_view_and_agree_with_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("rooms");
    let done = rooms(&out, &["--rooms", "2", "--views", "2", "--seed", "7"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let (images, depths, views) = (npy(&out.join("images.npy")), npy(&out.join("depth_m.npy")), npy(&out.join("views.npy")));
    assert!(images.0.contains("'|u1'") && images.0.contains("(4, 192, 320,)"), "{}", images.0);
    assert!(depths.0.contains("'<f4'") && depths.0.contains("(4, 48, 80,)"), "{}", depths.0);
    assert!(views.0.contains("'<f8'") && views.0.contains("(4, 12,)"), "{}", views.0);
    assert_eq!((images.1.len(), depths.1.len(), views.1.len()), (4 * 192 * 320, 4 * 48 * 80 * 4, 4 * 12 * 8));
    let seeds: Vec<f64> = views.1.chunks_exact(12 * 8).map(|row| f64::from_le_bytes(row[..8].try_into().unwrap())).collect();
    assert_eq!(seeds, [7.0, 7.0, 8.0, 8.0]);
    let depth = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    assert!(depths.1.chunks_exact(4).all(|bytes| (0.05..40.0).contains(&depth(bytes))));
    // A second time the folder is taken, and stays as it is.
    let again = rooms(&out, &["--rooms", "1", "--views", "1"]);
    assert_eq!(again.status.code(), Some(5));
    assert!(String::from_utf8_lossy(&again.stderr).contains("holds views already"));
    assert_eq!(npy(&out.join("images.npy")), images);
}

#[test]
fn no_views_at_all_are_refused_with_the_range_and_leave_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("rooms");
    for arguments in [["--views", "0"], ["--views", "10001"], ["--threads", "0"]] {
        let done = rooms(&out, &arguments);
        assert_eq!(done.status.code(), Some(2));
        let message = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(message.contains(" to ") && message.contains(&arguments[0][2..]), "{message}");
    }
    assert!(!out.exists());
}

#!/usr/bin/env bash
# Everything on ARM, each part by itself: `.ci/arm.sh [firmware|c|linux]...`, all of them by default. Called by `.ci/run`; installs what
# is missing when root. Where the usual toolchain has the targets, it is used; else Debian's compiler, see scripts/arm-*.
set -euo pipefail
cd "$(dirname "$0")/.."
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}
[ $# -gt 0 ] || set -- firmware c linux

has_target() { compgen -G "$(rustc --print target-libdir --target "$1")/libcore-*.rlib" >/dev/null; }

firmware() { # the estimator on emulated microcontrollers, and the same main loop on this machine
  # Alone: beside the host the core would compute with the logarithm of this machine's libc, which differs from libm's in the last bit.
  cargo test --manifest-path firmware-sim/Cargo.toml
  cargo clippy --manifest-path firmware-sim/Cargo.toml --all-targets -- -D warnings
  firmware-sim/run
}

c() { # the C interface: on this machine with its example, and as an archive for a microcontroller
  ffi/example/run
  has_target thumbv7em-none-eabihf || { scripts/arm-setup thumbv7em-none-eabihf && . scripts/arm-env; }
  cargo build -p libella-ffi --no-default-features --release --target thumbv7em-none-eabihf
}

linux() { # a 64-bit ARM Linux: the core's tests, the firmware's flight, and the program on a simulated flight
  local target=aarch64-unknown-linux-gnu out=$CARGO_TARGET_DIR/arm-linux
  # The same on this machine, to compare with: what the tests have built. Networks are left out on ARM: they alone would take twenty minutes to compile.
  local here=$CARGO_TARGET_DIR/debug/libella
  [ -x "$here" ] || cargo build -p libella-host
  scripts/arm-linux-setup
  # shellcheck source=scripts/arm-linux-env
  . scripts/arm-linux-env
  # Without two that start over and over: they alone take minutes under emulation.
  cargo test -p libella-core --lib --target "$target" -- --skip over_a_hundred_seeds --skip real_motion_starts_with_simulated_points
  # Without the examples in its documentation: they would need a rustdoc of that toolchain.
  cargo test --manifest-path firmware-sim/Cargo.toml --lib --tests --target "$target"
  cargo build -p libella-host --no-default-features --target "$target" --profile emulated
  rm -rf "$out"
  mkdir -p "$out"
  "$here" simulate --trajectory medium --duration 5 --no-depth --quiet --out "$out/flight"
  "$here" run "$out/flight" --out "$out/here"
  qemu-aarch64-static -L /usr/aarch64-linux-gnu "$CARGO_TARGET_DIR/$target/emulated/libella" run "$out/flight" --out "$out/arm"
  python3 .ci/same_trajectory.py 1e-3 "$out/here/trajectory.tum" "$out/arm/trajectory.tum"
}

for part in "$@"; do
  # In a shell of its own: each part chooses its compiler.
  (set -e; "$part")
done

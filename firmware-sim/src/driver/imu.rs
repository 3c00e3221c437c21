//! The inertial sensor.

use libella_core::imu::ImuSample;
use libella_core::time::Timestamp;

use crate::fault::Fault;
use crate::replay::Replay;

/// Gives the samples of a recording when they are due.
#[derive(Debug)]
pub struct Imu<'a> {
    replay: &'a Replay<'a>,
    fault: Fault,
    began: Timestamp,
    next: usize,
}

impl<'a> Imu<'a> {
    /// A sensor that was switched on at `began`.
    #[must_use]
    pub fn new(replay: &'a Replay<'a>, fault: Fault, began: Timestamp) -> Self {
        let next = (0..).take_while(|index| replay.sample(*index).is_some_and(|sample| sample.stamp < began)).count();
        Self { replay, fault, began, next }
    }

    /// The next sample taken until `now`.
    pub fn poll(&mut self, now: Timestamp) -> Option<ImuSample<f32>> {
        loop {
            let mut sample = self.replay.sample(self.next).filter(|sample| sample.stamp <= now)?;
            self.next += 1;
            let elapsed = sample.stamp - self.began;
            sample.stamp = self.fault.stamped(elapsed, sample.stamp);
            if self.fault.is_on(elapsed) {
                match self.fault {
                    Fault::Gap => continue,
                    Fault::NanImu => sample.gyro_rad_s.x = f32::NAN,
                    _ => {}
                }
            }
            return Some(sample);
        }
    }

    /// Whether all samples were given.
    #[must_use]
    pub fn is_at_end(&self) -> bool {
        self.next >= self.replay.header().samples
    }
}

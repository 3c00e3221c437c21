//! The topics of a recording, what is on them, and which are meant.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use libella_core::imu::ImuSample;
use libella_core::time::Timestamp;

use super::fields::Encoding;
use super::messages::{self, Content};
use super::{Container, PackedImage};
use crate::dataset::Place;
use crate::fault::{Fault, FaultKind};

/// Names that a complaint lists at most.
const MOST_LISTED: usize = 8;

/// A topic and its messages: inertial samples, or when and where images were.
pub(super) struct Topic {
    pub(super) name: String,
    pub(super) content: Content,
    pub(super) encoding: Encoding,
    pub(super) samples: Vec<ImuSample<f64>>,
    pub(super) images: Vec<PackedImage>,
    count: u64,
    /// The first message that could not be read, and why.
    fault: Option<String>,
}

/// All topics of a recording.
#[derive(Default)]
pub(super) struct Topics {
    read: BTreeMap<String, Topic>,
    /// Topics of other types, to name them.
    others: BTreeMap<String, String>,
}

impl Topics {
    /// Takes all messages of a file.
    pub(super) fn gather(&mut self, container: &mut dyn Container, file: u32) -> Result<(), Fault> {
        let mut channels: HashMap<u32, String> = HashMap::new();
        while let Some(chunk) = container.next_chunk()? {
            for channel in &chunk.channels {
                match (Content::of(&channel.type_name), channel.encoding) {
                    (Some(content), Some(encoding)) => {
                        let empty = || Topic {
                            name: channel.topic.clone(),
                            content,
                            encoding,
                            samples: Vec::new(),
                            images: Vec::new(),
                            count: 0,
                            fault: None,
                        };
                        let topic = self.read.entry(channel.topic.clone()).or_insert_with(empty);
                        if (topic.content, topic.encoding) != (content, encoding) {
                            topic.fault.get_or_insert_with(|| "holds messages of several types".into());
                        }
                        channels.insert(channel.id, channel.topic.clone());
                    }
                    _ => drop(self.others.insert(channel.topic.clone(), channel.type_name.clone())),
                }
            }
            for (index, message) in chunk.messages.iter().enumerate() {
                let Some(topic) = channels.get(&message.channel).and_then(|name| self.read.get_mut(name)) else { continue };
                let place = Place { file, position: chunk.position, index: u32::try_from(index).unwrap_or(u32::MAX) };
                topic.take(place, chunk.data.get(message.range.clone()).unwrap_or_default());
            }
        }
        Ok(())
    }

    /// The inertial samples: of the topic that is told, else of that of the calibration, else of the only one.
    pub(super) fn inertial(&mut self, path: &Path, told: Option<&str>, calibrated: Option<&str>) -> Result<Topic, Fault> {
        let wanted = Wanted { option: "--imu-topic", type_name: "sensor_msgs/Imu", is: |content| content == Content::Imu };
        self.choose(path, &wanted, told, calibrated)
    }

    /// The images, chosen alike.
    pub(super) fn pictures(&mut self, path: &Path, told: Option<&str>, calibrated: Option<&str>) -> Result<Topic, Fault> {
        let type_name = "sensor_msgs/Image or sensor_msgs/CompressedImage";
        let wanted = Wanted { option: "--image-topic", type_name, is: |content| content != Content::Imu };
        self.choose(path, &wanted, told, calibrated)
    }

    fn choose(&mut self, path: &Path, wanted: &Wanted, told: Option<&str>, calibrated: Option<&str>) -> Result<Topic, Fault> {
        let Wanted { option, type_name, is } = wanted;
        let fitting: Vec<&str> =
            self.read.values().filter(|topic| is(topic.content) && topic.count > 0).map(|topic| &*topic.name).collect();
        let name = match (told, &fitting[..]) {
            (Some(told), _) if fitting.contains(&told) => told,
            (Some(told), _) => {
                let known = self.others.get(told).map(String::as_str).or_else(|| self.read.contains_key(told).then_some("another type"));
                let what = match known {
                    Some(other) => format!("topic `{told}` holds no {type_name} but {other}"),
                    None => format!("has no topic `{told}`"),
                };
                let there = if fitting.is_empty() { "there is none that fits".into() } else { format!("give {}", listed(&fitting)) };
                return Err(Fault::new(FaultKind::Configuration, what, format!("{there} with {option}")).at(path));
            }
            (None, []) => {
                let all: Vec<&str> = self.read.keys().chain(self.others.keys()).map(String::as_str).collect();
                let there = if all.is_empty() { "no topic at all".into() } else { listed(&all) };
                let what = format!("has no messages of type {type_name}, only {there}");
                return Err(Fault::malformed(path, what, "record camera and inertial unit together"));
            }
            (None, [only]) => only,
            (None, _) => match calibrated.filter(|name| fitting.contains(name)) {
                Some(name) => name,
                None => {
                    let what = format!("has {} topics of type {type_name}: {}", fitting.len(), listed(&fitting));
                    return Err(Fault::new(FaultKind::Configuration, what, format!("choose one with {option}")).at(path));
                }
            },
        };
        let name = name.to_owned();
        let topic = self.read.get_mut(&name).ok_or_else(|| Fault::malformed(path, format!("has no topic `{name}`"), "record again"))?;
        match topic.fault.take() {
            Some(reason) => Err(Fault::malformed(path, format!("`{name}` {reason}"), "record again, or leave this topic out")),
            // The name stays, for complaints about other choices.
            None => Ok(Topic {
                samples: std::mem::take(&mut topic.samples),
                images: std::mem::take(&mut topic.images),
                name,
                fault: None,
                ..*topic
            }),
        }
    }
}

/// What a topic is sought for.
struct Wanted {
    option: &'static str,
    type_name: &'static str,
    is: fn(Content) -> bool,
}

impl Topic {
    fn take(&mut self, place: Place, message: &[u8]) {
        self.count += 1;
        let stamp = match self.content {
            Content::Imu => messages::imu(self.encoding, message).map(|sample| {
                self.samples.push(sample);
                sample.stamp
            }),
            _ => messages::stamp(self.encoding, message).inspect(|stamp| self.images.push(PackedImage { stamp: *stamp, place })),
        };
        let reason = match stamp {
            None => "is cut off or of another type than it says",
            Some(stamp) if stamp == Timestamp::default() => "has no time stamp in its header",
            Some(_) => return,
        };
        self.fault.get_or_insert_with(|| format!("message {} {reason}", self.count));
    }
}

fn listed(names: &[&str]) -> String {
    let more = if names.len() > MOST_LISTED { format!(" and {} more", names.len() - MOST_LISTED) } else { String::new() };
    let names: Vec<String> = names.iter().take(MOST_LISTED).map(|name| format!("`{}`", name.escape_debug())).collect();
    format!("{}{more}", names.join(", "))
}

//! A EuRoC folder as a zip archive, a ROS 1 bag, and MCAP as ROS 2 and ROS 1 would record it.
//!
//! The messages are written field by field after the definitions of ROS, the bag record by record after its format.
#![allow(clippy::unwrap_used, dead_code)]

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

pub const IMAGE_TOPIC: &str = "/cam0/image_raw";
pub const IMU_TOPIC: &str = "/imu0";

/// How the chunks of a bag are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    None,
    Bz2,
    Lz4,
}

/// How messages are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    Ros1,
    Cdr,
}

/// What the camera's messages hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pixels {
    Mono8,
    Bgr8,
    /// The image files as they are.
    Compressed,
}

/// A message to be written.
pub struct Message {
    pub nanos: i64,
    pub topic: &'static str,
    pub kind: &'static str,
    pub bytes: Vec<u8>,
}

/// The files below a folder, with `/` between their parts.
fn files_below(folder: &Path) -> BTreeMap<String, PathBuf> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        if entry.path().is_dir() {
            found.extend(files_below(&entry.path()).into_iter().map(|(below, path)| (format!("{name}/{below}"), path)));
        } else {
            found.insert(name, entry.path());
        }
    }
    found
}

/// Packs what lies below a folder; images as they are, tables compressed.
pub fn zip(folder: &Path, archive: &Path, prefix: &str) {
    let mut writer = zip::ZipWriter::new(std::fs::File::create(archive).unwrap());
    for (name, path) in files_below(folder) {
        let method = if name.ends_with(".png") { zip::CompressionMethod::Stored } else { zip::CompressionMethod::Deflated };
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        writer.start_file(format!("{prefix}{name}"), options).unwrap();
        writer.write_all(&std::fs::read(path).unwrap()).unwrap();
    }
    writer.finish().unwrap();
}

/// The lines of a table as columns of text.
fn table(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').map(|field| field.trim().to_owned()).collect()).collect()
}

/// All messages of the recording in `mav0`, in the order of time.
pub fn messages(mav0: &Path, wire: Wire, pixels: Pixels) -> Vec<Message> {
    let mut all = Vec::new();
    for row in table(&mav0.join("imu0/data.csv")) {
        let nanos: i64 = row[0].parse().unwrap();
        let value = |column: usize| row[column].parse::<f64>().unwrap();
        let mut message = Fields::new(wire, nanos, "imu");
        let (gyro, accel) = ([1, 2, 3].map(value), [4, 5, 6].map(value));
        // Orientation, angular velocity and linear acceleration, each with its covariance.
        for values in [&[0.0, 0.0, 0.0, 1.0][..], &[0.0; 9], &gyro, &[0.0; 9], &accel, &[0.0; 9]] {
            values.iter().for_each(|value| message.f64(*value));
        }
        all.push(Message { nanos, topic: IMU_TOPIC, kind: "sensor_msgs/Imu", bytes: message.bytes });
    }
    for row in table(&mav0.join("cam0/data.csv")) {
        let nanos: i64 = row[0].parse().unwrap();
        let file = mav0.join("cam0/data").join(&row[1]);
        let mut message = Fields::new(wire, nanos, "cam0");
        if pixels == Pixels::Compressed {
            message.string("png");
            message.list(&std::fs::read(file).unwrap());
            all.push(Message { nanos, topic: IMAGE_TOPIC, kind: "sensor_msgs/CompressedImage", bytes: message.bytes });
            continue;
        }
        let image = image::open(file).unwrap().into_luma8();
        let (encoding, step, data) = match pixels {
            Pixels::Bgr8 => ("bgr8", image.width() * 3, image.pixels().flat_map(|pixel| [pixel.0[0]; 3]).collect()),
            _ => ("mono8", image.width(), image.as_raw().clone()),
        };
        message.u32(image.height());
        message.u32(image.width());
        message.string(encoding);
        message.bytes.push(0);
        message.u32(step);
        message.list(&data);
        all.push(Message { nanos, topic: IMAGE_TOPIC, kind: "sensor_msgs/Image", bytes: message.bytes });
    }
    all.sort_by_key(|message| message.nanos);
    all
}

/// Writes the fields of a message one after the other.
struct Fields {
    wire: Wire,
    bytes: Vec<u8>,
}

impl Fields {
    fn new(wire: Wire, nanos: i64, frame: &str) -> Self {
        let mut fields = Self { wire, bytes: if wire == Wire::Cdr { vec![0, 1, 0, 0] } else { vec![7, 0, 0, 0] } };
        fields.u32(u32::try_from(nanos / 1_000_000_000).unwrap());
        fields.u32(u32::try_from(nanos % 1_000_000_000).unwrap());
        fields.string(frame);
        fields
    }

    fn align(&mut self, size: usize) {
        while self.wire == Wire::Cdr && !(self.bytes.len() - 4).is_multiple_of(size) {
            self.bytes.push(0);
        }
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
    }

    fn list(&mut self, bytes: &[u8]) {
        self.u32(u32::try_from(bytes.len()).unwrap());
        self.bytes.extend(bytes);
    }

    fn string(&mut self, text: &str) {
        let end: &[u8] = if self.wire == Wire::Cdr { b"\0" } else { b"" };
        self.list(&[text.as_bytes(), end].concat());
    }
}

/// The topics of messages with their types, numbered as they come.
fn topics(messages: &[Message]) -> Vec<(&'static str, &'static str)> {
    let mut topics = Vec::new();
    for message in messages {
        if !topics.contains(&(message.topic, message.kind)) {
            topics.push((message.topic, message.kind));
        }
    }
    topics
}

/// Writes a ROS 1 bag with chunks of so many messages.
pub fn bag(path: &Path, messages: &[Message], packing: Packing, per_chunk: usize) {
    let topics = topics(messages);
    let number = |message: &Message| u32::try_from(topics.iter().position(|(topic, _)| *topic == message.topic).unwrap()).unwrap();
    let connections: Vec<u8> = topics
        .iter()
        .enumerate()
        .flat_map(|(id, (topic, kind))| {
            let data = header(&[
                ("topic", topic.as_bytes()),
                ("type", kind.as_bytes()),
                ("md5sum", b"0123456789abcdef0123456789abcdef"),
                ("message_definition", b"# left out"),
            ]);
            record(&[("op", &[0x07]), ("conn", &u32::try_from(id).unwrap().to_le_bytes()), ("topic", topic.as_bytes())], &data)
        })
        .collect();
    let bag_header = |index: u64, chunks: usize| {
        let fields = header(&[
            ("op", &[0x03]),
            ("index_pos", &index.to_le_bytes()),
            ("conn_count", &u32::try_from(topics.len()).unwrap().to_le_bytes()),
            ("chunk_count", &u32::try_from(chunks).unwrap().to_le_bytes()),
        ]);
        let padding = vec![b' '; 4096 - 8 - fields.len()];
        [&length(&fields)[..], &fields, &length(&padding), &padding].concat()
    };
    let mut bytes = [&b"#ROSBAG V2.0\n"[..], &bag_header(0, 0)].concat();
    let (mut infos, mut chunks) = (Vec::new(), 0);
    for group in messages.chunks(per_chunk) {
        let mut content = if chunks == 0 { connections.clone() } else { Vec::new() };
        let mut offsets: BTreeMap<u32, Vec<u8>> = BTreeMap::new();
        for message in group {
            let entry = [&time(message.nanos)[..], &u32::try_from(content.len()).unwrap().to_le_bytes()].concat();
            offsets.entry(number(message)).or_default().extend(entry);
            let fields = [("op", &[0x02][..]), ("conn", &number(message).to_le_bytes()), ("time", &time(message.nanos))];
            content.extend(record(&fields, &message.bytes));
        }
        let (name, packed) = match packing {
            Packing::None => ("none", content.clone()),
            Packing::Bz2 => {
                let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
                encoder.write_all(&content).unwrap();
                ("bz2", encoder.finish().unwrap())
            }
            Packing::Lz4 => {
                let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                encoder.write_all(&content).unwrap();
                ("lz4", encoder.finish().unwrap())
            }
        };
        let position = bytes.len() as u64;
        let size = length(&content);
        bytes.extend(record(&[("op", &[0x05]), ("compression", name.as_bytes()), ("size", &size)], &packed));
        let mut counts = Vec::new();
        for (id, entries) in &offsets {
            let count = u32::try_from(entries.len() / 12).unwrap().to_le_bytes();
            bytes
                .extend(record(&[("op", &[0x04]), ("ver", &1_u32.to_le_bytes()), ("conn", &id.to_le_bytes()), ("count", &count)], entries));
            counts.extend([id.to_le_bytes(), count].concat());
        }
        infos.extend(record(
            &[
                ("op", &[0x06]),
                ("ver", &1_u32.to_le_bytes()),
                ("chunk_pos", &position.to_le_bytes()),
                ("start_time", &time(group[0].nanos)),
                ("end_time", &time(group[group.len() - 1].nanos)),
                ("count", &u32::try_from(offsets.len()).unwrap().to_le_bytes()),
            ],
            &counts,
        ));
        chunks += 1;
    }
    let index = bytes.len() as u64;
    bytes.extend(connections);
    bytes.extend(infos);
    let head = bag_header(index, chunks);
    bytes[13..13 + head.len()].copy_from_slice(&head);
    std::fs::write(path, bytes).unwrap();
}

fn length(bytes: &[u8]) -> [u8; 4] {
    u32::try_from(bytes.len()).unwrap().to_le_bytes()
}

fn time(nanos: i64) -> [u8; 8] {
    let part = |value: i64| u32::try_from(value).unwrap().to_le_bytes();
    [part(nanos / 1_000_000_000), part(nanos % 1_000_000_000)].concat().try_into().unwrap()
}

fn header(fields: &[(&str, &[u8])]) -> Vec<u8> {
    fields
        .iter()
        .flat_map(|(name, value)| {
            let field = [name.as_bytes(), b"=", value].concat();
            [&length(&field)[..], &field].concat()
        })
        .collect()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header = header(fields);
    [&length(&header)[..], &header, &length(data), data].concat()
}

/// Writes an MCAP file with the crate of its makers, in chunks or without.
pub fn mcap(path: &Path, messages: &[Message], wire: Wire, chunk_bytes: Option<u64>) {
    let options = mcap::WriteOptions::new().use_chunks(chunk_bytes.is_some()).chunk_size(chunk_bytes).compression(None);
    let mut writer = options.create(std::io::BufWriter::new(std::fs::File::create(path).unwrap())).unwrap();
    let (encoding, schema_encoding) = if wire == Wire::Cdr { ("cdr", "ros2msg") } else { ("ros1", "ros1msg") };
    let mut channels = BTreeMap::new();
    for (topic, kind) in topics(messages) {
        let kind = if wire == Wire::Cdr { kind.replace('/', "/msg/") } else { kind.to_owned() };
        let schema = writer.add_schema(&kind, schema_encoding, b"# left out").unwrap();
        channels.insert(topic, writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap());
    }
    for (sequence, message) in messages.iter().enumerate() {
        let nanos = u64::try_from(message.nanos).unwrap();
        let header = mcap::records::MessageHeader {
            channel_id: channels[message.topic],
            sequence: u32::try_from(sequence).unwrap(),
            log_time: nanos,
            publish_time: nanos,
        };
        writer.write_to_known_channel(&header, &message.bytes).unwrap();
    }
    writer.finish().unwrap();
}

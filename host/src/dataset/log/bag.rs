//! The records of a ROS 1 bag, version 2.0.
//!
//! A record is a header (length, then fields `name=value`, each behind its length) and data (length, then bytes); the field `op` says what
//! it is. Connections and messages lie in chunks, which may be compressed. The crates that read bags map the file into memory, unpack
//! without a bound and end the program at a bag that was cut off, so that the records are read here; crates unpack the chunks.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::fields::Encoding;
use super::unpack::{MOST_CHUNK_BYTES, unpack};
use super::{Channel, Chunk, Container, Entry, cut_off, damaged};
use crate::fault::Fault;

const MESSAGE: u8 = 0x02;
const HEADER: u8 = 0x03;
const CHUNK: u8 = 0x05;
const CHUNK_INFO: u8 = 0x06;
const CONNECTION: u8 = 0x07;
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
const REMEDY: &str = "mend it with `rosbag reindex`, or copy it again";

/// An open bag.
pub(super) struct Bag {
    path: PathBuf,
    file: BufReader<File>,
    length: u64,
    at: u64,
    /// Chunks and their entries in the index that are still to come.
    missing: [u32; 2],
}

/// The header of a record and where its data lie.
type Head = (Vec<u8>, Range<u64>);

impl Bag {
    /// Opens a bag and reads its first record.
    pub(super) fn open(path: &Path) -> Result<Self, Fault> {
        let (file, length) = super::open_file(path)?;
        let mut bag = Self { path: path.to_path_buf(), file, length, at: 0, missing: [0; 2] };
        bag.seek(MAGIC.len() as u64)?;
        let (header, data) = bag.head()?.ok_or_else(|| cut_off(path, REMEDY))?;
        let fields = Header(&header);
        let (Some(HEADER), Some(index)) = (fields.op(), fields.u64("index_pos")) else {
            return Err(damaged(path, "its first record is no bag header", REMEDY));
        };
        if index == 0 {
            return Err(Fault::malformed(path, "has no index: its recording was not ended properly", "run `rosbag reindex` on it"));
        }
        if index > length {
            return Err(cut_off(path, REMEDY));
        }
        bag.missing = [fields.u32("chunk_count").unwrap_or(0); 2];
        bag.seek(data.end)?;
        Ok(bag)
    }

    fn seek(&mut self, position: u64) -> Result<(), Fault> {
        self.at = position;
        self.file.seek(SeekFrom::Start(position)).map(|_| ()).map_err(|error| damaged(&self.path, &error.to_string(), REMEDY))
    }

    fn read(&mut self, count: u64) -> Result<Vec<u8>, Fault> {
        if count > self.length.saturating_sub(self.at) {
            return Err(cut_off(&self.path, REMEDY));
        }
        let mut bytes = Vec::new();
        let read = (&mut self.file).take(count).read_to_end(&mut bytes);
        read.map_err(|error| damaged(&self.path, &error.to_string(), REMEDY))?;
        self.at += count;
        if bytes.len() as u64 == count { Ok(bytes) } else { Err(cut_off(&self.path, REMEDY)) }
    }

    fn length(&mut self) -> Result<u64, Fault> {
        let bytes = self.read(4)?;
        Ok(bytes.try_into().map_or(0, |bytes| u64::from(u32::from_le_bytes(bytes))))
    }

    /// The header of the next record and where its data lie; the file stands at the data. `None` at the end of the file.
    fn head(&mut self) -> Result<Option<Head>, Fault> {
        if self.at == self.length {
            return Ok(None);
        }
        let count = self.length()?;
        let header = self.read(count)?;
        let count = self.length()?;
        let data = self.at..self.at + count;
        if data.end > self.length {
            return Err(cut_off(&self.path, REMEDY));
        }
        Ok(Some((header, data)))
    }

    fn chunk(&mut self, position: u64, header: &[u8], count: u64) -> Result<Chunk, Fault> {
        let fault = |reason: &str| damaged(&self.path, &format!("the chunk at byte {position} {reason}"), REMEDY);
        let fields = Header(header);
        let (Some(compression), Some(size)) = (fields.text("compression"), fields.u32("size")) else {
            return Err(fault("says neither its compression nor its size"));
        };
        if count > MOST_CHUNK_BYTES {
            return Err(fault(&format!("has {} MB, more than {} MB are refused", count >> 20, MOST_CHUNK_BYTES >> 20)));
        }
        let (compression, size) = (compression.to_owned(), u64::from(size));
        let packed = self.read(count)?;
        let fault = |reason: &str| damaged(&self.path, &format!("the chunk at byte {position} {reason}"), REMEDY);
        let data = unpack(&compression, packed, size).map_err(|reason| fault(&reason))?;
        let mut chunk = Chunk { position, data, channels: Vec::new(), messages: Vec::new() };
        let mut at = 0;
        while at < chunk.data.len() {
            let record = record(&chunk.data, at).ok_or_else(|| fault("holds a record that is cut off"))?;
            at = record.data.end;
            let fields = Header(chunk.data.get(record.header).unwrap_or_default());
            match fields.op() {
                Some(MESSAGE) => {
                    let channel = fields.u32("conn").ok_or_else(|| fault("holds a message without a connection"))?;
                    chunk.messages.push(Entry { channel, range: record.data });
                }
                Some(CONNECTION) => {
                    let data = chunk.data.get(record.data).unwrap_or_default();
                    let channel = connection(fields, data).ok_or_else(|| fault("holds a connection without topic or type"))?;
                    chunk.channels.push(channel);
                }
                _ => return Err(fault("holds a record of a kind that does not belong there")),
            }
        }
        Ok(chunk)
    }
}

impl Container for Bag {
    fn next_chunk(&mut self) -> Result<Option<Chunk>, Fault> {
        loop {
            let position = self.at;
            let Some((header, data)) = self.head()? else {
                return if self.missing == [0; 2] { Ok(None) } else { Err(cut_off(&self.path, REMEDY)) };
            };
            let fields = Header(&header);
            match fields.op() {
                Some(CHUNK) => {
                    self.missing[0] = self.missing[0].saturating_sub(1);
                    return self.chunk(position, &header, data.end - data.start).map(Some);
                }
                // Connections are repeated at the end, where all of their messages have been seen; before them, here for a bag without
                // a message.
                Some(CONNECTION) => {
                    let bytes = self.read(data.end - data.start)?;
                    let channel = connection(Header(&header), &bytes)
                        .ok_or_else(|| damaged(&self.path, &format!("the connection at byte {position} has no topic or type"), REMEDY))?;
                    return Ok(Some(Chunk { position, data: Vec::new(), channels: vec![channel], messages: Vec::new() }));
                }
                Some(kind) => {
                    self.missing[1] = self.missing[1].saturating_sub(u32::from(kind == CHUNK_INFO));
                    self.seek(data.end)?;
                }
                None => return Err(damaged(&self.path, &format!("the record at byte {position} does not say what it is"), REMEDY)),
            }
        }
    }

    fn chunk_at(&mut self, position: u64) -> Result<Chunk, Fault> {
        self.seek(position)?;
        match self.head()? {
            Some((header, data)) if Header(&header).op() == Some(CHUNK) => self.chunk(position, &header, data.end - data.start),
            _ => Err(damaged(&self.path, &format!("there is no chunk at byte {position} any more"), REMEDY)),
        }
    }
}

fn connection(fields: Header<'_>, data: &[u8]) -> Option<Channel> {
    let more = Header(data);
    Some(Channel {
        id: fields.u32("conn")?,
        topic: fields.text("topic").or_else(|| more.text("topic"))?.to_owned(),
        type_name: more.text("type")?.to_owned(),
        encoding: Some(Encoding::Ros1),
    })
}

/// Where header and data of a record within a chunk lie.
struct Record {
    header: Range<usize>,
    data: Range<usize>,
}

fn record(bytes: &[u8], at: usize) -> Option<Record> {
    let part = |at: usize| {
        let begin = at.checked_add(4)?;
        let count = u32::from_le_bytes(bytes.get(at..begin)?.try_into().ok()?);
        let end = begin.checked_add(usize::try_from(count).ok()?)?;
        (end <= bytes.len()).then_some(begin..end)
    };
    let header = part(at)?;
    let data = part(header.end)?;
    Some(Record { header, data })
}

/// The fields `name=value` of a header.
#[derive(Clone, Copy)]
struct Header<'a>(&'a [u8]);

impl<'a> Header<'a> {
    fn field(self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((count, more)) = rest.split_first_chunk() {
            let (field, more) = more.split_at_checked(usize::try_from(u32::from_le_bytes(*count)).ok()?)?;
            if let Some(value) = field.strip_prefix(name.as_bytes()).and_then(|value| value.strip_prefix(b"=")) {
                return Some(value);
            }
            rest = more;
        }
        None
    }

    fn op(self) -> Option<u8> {
        self.field("op").and_then(|value| value.first().copied())
    }

    fn u32(self, name: &str) -> Option<u32> {
        Some(u32::from_le_bytes(self.field(name)?.try_into().ok()?))
    }

    fn u64(self, name: &str) -> Option<u64> {
        Some(u64::from_le_bytes(self.field(name)?.try_into().ok()?))
    }

    fn text(self, name: &str) -> Option<&'a str> {
        std::str::from_utf8(self.field(name)?).ok()
    }
}

//! The records of an MCAP file, by the crate of its makers.
//!
//! A record is its kind (a byte), its length (eight bytes) and its content. Files are walked from record to record: what is not needed is
//! skipped and not read, no length is believed that goes beyond the end of the file, and chunks are unpacked into a bounded memory.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};

use super::fields::Encoding;
use super::unpack::{MOST_CHUNK_BYTES, unpack};
use super::{Channel, Chunk, Container, Entry, cut_off, damaged};
use crate::fault::Fault;

/// Kind and length of a record.
const HEAD: u64 = 9;
/// Channel and sequence number of a message, and its two times.
const MESSAGE_HEAD: usize = 22;
const REMEDY: &str = "mend it with `mcap recover`, or copy it again";

/// An open file.
pub(super) struct Mcap {
    path: PathBuf,
    file: BufReader<File>,
    length: u64,
    at: u64,
    /// Types by their number.
    schemas: HashMap<u16, String>,
}

impl Mcap {
    /// Opens a file that begins and ends as MCAP does.
    pub(super) fn open(path: &Path) -> Result<Self, Fault> {
        let (file, length) = super::open_file(path)?;
        let mut opened = Self { path: path.to_path_buf(), file, length, at: 0, schemas: HashMap::new() };
        let magic = mcap::MAGIC.len() as u64;
        if opened.read(magic)? != mcap::MAGIC {
            return Err(Fault::malformed(path, "is no MCAP file", "give one that ROS 2 recorded"));
        }
        opened.seek(length.saturating_sub(magic))?;
        if length < 2 * magic || opened.read(magic)? != mcap::MAGIC {
            return Err(cut_off(path, REMEDY));
        }
        opened.seek(magic)?;
        Ok(opened)
    }

    fn seek(&mut self, position: u64) -> Result<(), Fault> {
        self.at = position;
        self.file.seek(SeekFrom::Start(position)).map(|_| ()).map_err(|error| damaged(&self.path, &error.to_string(), REMEDY))
    }

    fn read(&mut self, count: u64) -> Result<Vec<u8>, Fault> {
        let mut bytes = Vec::new();
        let read = (&mut self.file).take(count).read_to_end(&mut bytes);
        read.map_err(|error| damaged(&self.path, &error.to_string(), REMEDY))?;
        self.at += count;
        if bytes.len() as u64 == count { Ok(bytes) } else { Err(cut_off(&self.path, REMEDY)) }
    }

    /// The next record of the file: kind and length of its content, at which the file stands.
    fn head(&mut self) -> Result<(u8, u64), Fault> {
        let position = self.at;
        let head = self.read(HEAD)?;
        let Some((kind, count)) = head.split_first() else { return Err(cut_off(&self.path, REMEDY)) };
        let count = <[u8; 8]>::try_from(count).map_or(u64::MAX, u64::from_le_bytes);
        if count > self.length.saturating_sub(self.at) {
            return Err(cut_off(&self.path, REMEDY));
        }
        if count > MOST_CHUNK_BYTES && matches!(*kind, op::CHUNK | op::MESSAGE | op::SCHEMA | op::CHANNEL) {
            let what = format!("the record at byte {position} has {} MB, more than {} MB are refused", count >> 20, MOST_CHUNK_BYTES >> 20);
            return Err(damaged(&self.path, &what, REMEDY));
        }
        Ok((*kind, count))
    }

    /// The chunk whose content has been read, or a message or channel that lies in none.
    fn chunk(&mut self, position: u64, kind: u8, content: Vec<u8>) -> Result<Chunk, Fault> {
        let path = self.path.clone();
        let fault = |reason: &str| damaged(&path, &format!("the chunk at byte {position} {reason}"), REMEDY);
        let mut chunk = Chunk { position, data: Vec::new(), channels: Vec::new(), messages: Vec::new() };
        if kind != op::CHUNK {
            self.record(&mut chunk, kind, &content, 0).map_err(|reason| fault(&reason))?;
            chunk.data = content;
            return Ok(chunk);
        }
        let (header, packed) = match mcap::parse_record(kind, &content) {
            Ok(Record::Chunk { header, data }) => (header, data.into_owned()),
            Ok(_) => return Err(fault("is none")),
            Err(error) => return Err(fault(&error.to_string())),
        };
        drop(content);
        let data = unpack(&header.compression, packed, header.uncompressed_size).map_err(|reason| fault(&reason))?;
        if header.uncompressed_crc != 0 && crc32fast::hash(&data) != header.uncompressed_crc {
            return Err(fault("has another checksum than it says"));
        }
        let mut rest = &data[..];
        while let Some((head, more)) = rest.split_first_chunk::<9>() {
            let [kind, count @ ..] = *head;
            let count = usize::try_from(u64::from_le_bytes(count)).unwrap_or(usize::MAX);
            let (content, more) = more.split_at_checked(count).ok_or_else(|| fault("holds a record that is cut off"))?;
            self.record(&mut chunk, kind, content, data.len() - more.len() - count).map_err(|reason| fault(&reason))?;
            rest = more;
        }
        if !rest.is_empty() {
            return Err(fault("holds a record that is cut off"));
        }
        chunk.data = data;
        Ok(chunk)
    }

    /// Notes what a record says: types, channels, and where messages lie.
    fn record(&mut self, chunk: &mut Chunk, kind: u8, content: &[u8], offset: usize) -> Result<(), String> {
        if !matches!(kind, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
            return Ok(());
        }
        match mcap::parse_record(kind, content).map_err(|error| format!("holds a damaged record ({error})"))? {
            Record::Schema { header, .. } => drop(self.schemas.insert(header.id, header.name)),
            Record::Channel(channel) => {
                let type_name = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let encoding = match channel.message_encoding.as_str() {
                    "cdr" => Some(Encoding::Cdr),
                    "ros1" => Some(Encoding::Ros1),
                    _ => None,
                };
                chunk.channels.push(Channel { id: channel.id.into(), topic: channel.topic, type_name, encoding });
            }
            Record::Message { header, .. } => {
                chunk.messages.push(Entry { channel: header.channel_id.into(), range: offset + MESSAGE_HEAD..offset + content.len() });
            }
            _ => {}
        }
        Ok(())
    }
}

impl Container for Mcap {
    fn next_chunk(&mut self) -> Result<Option<Chunk>, Fault> {
        loop {
            let position = self.at;
            let (kind, count) = self.head()?;
            match kind {
                // What follows repeats what has been seen.
                op::DATA_END | op::FOOTER => return Ok(None),
                op::CHUNK | op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    let content = self.read(count)?;
                    return self.chunk(position, kind, content).map(Some);
                }
                _ => self.seek(self.at + count)?,
            }
        }
    }

    fn chunk_at(&mut self, position: u64) -> Result<Chunk, Fault> {
        self.seek(position)?;
        let (kind, count) = self.head()?;
        let content = self.read(count)?;
        self.chunk(position, kind, content)
    }
}

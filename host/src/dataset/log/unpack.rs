//! Chunks that are compressed, unpacked into no more memory than they say they need.

use std::io::Read;

/// The largest chunk; recorders make them of 1 to 4 MB.
pub(super) const MOST_CHUNK_BYTES: u64 = 512 << 20;

/// Unpacks a chunk of a stated size.
///
/// # Errors
/// What is wrong with it.
pub(super) fn unpack(compression: &str, packed: Vec<u8>, size: u64) -> Result<Vec<u8>, String> {
    if size > MOST_CHUNK_BYTES {
        return Err(format!("says it unpacks to {} MB, more than {} MB are refused", size >> 20, MOST_CHUNK_BYTES >> 20));
    }
    let unpacked = match compression {
        "" | "none" => Ok(packed),
        "lz4" => all_of(lz4_flex::frame::FrameDecoder::new(&packed[..]), size),
        "bz2" => all_of(bzip2::read::MultiBzDecoder::new(&packed[..]), size),
        "zstd" => {
            ruzstd::decoding::StreamingDecoder::new(&packed[..]).map_err(|error| error.to_string()).and_then(|from| all_of(from, size))
        }
        other => return Err(format!("is compressed by `{}`, which is not supported", other.escape_debug())),
    };
    match unpacked {
        Ok(data) if data.len() as u64 == size => Ok(data),
        Ok(_) => Err(format!("does not unpack to the {size} bytes that it says")),
        Err(reason) => Err(format!("cannot be unpacked ({})", reason.replace('\n', " "))),
    }
}

fn all_of(from: impl Read, size: u64) -> Result<Vec<u8>, String> {
    let mut data = Vec::new();
    from.take(size + 1).read_to_end(&mut data).map_err(|error| error.to_string())?;
    Ok(data)
}

//! The two ways in which ROS writes a message: that of ROS 1, and CDR (ROS 2).
//!
//! ROS 1 is little-endian without padding; strings end without NUL, headers begin with a sequence number. CDR begins with four bytes that
//! say the order of bytes and the version; every number lies at a multiple of its size, counted from behind those four, eight-byte numbers
//! in version 2 at multiples of four; strings end with NUL, which their length counts.

use libella_core::time::Timestamp;

/// How a message is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ros1,
    Cdr,
}

/// Reads the fields of a message one after the other; `None` where it ends before.
pub(super) struct Fields<'a> {
    data: &'a [u8],
    at: usize,
    encoding: Encoding,
    is_big_endian: bool,
    largest_alignment: usize,
}

impl<'a> Fields<'a> {
    pub(super) fn new(encoding: Encoding, message: &'a [u8]) -> Option<Self> {
        let fields = |data, is_big_endian, largest_alignment| Self { data, at: 0, encoding, is_big_endian, largest_alignment };
        match (encoding, message) {
            (Encoding::Ros1, _) => Some(fields(message, false, 1)),
            // CDR and CDR2 without the extensions that lists of optional fields need.
            (Encoding::Cdr, [0, order @ (0 | 1), _, _, data @ ..]) => Some(fields(data, *order == 0, 8)),
            (Encoding::Cdr, [0, order @ (6 | 7), _, _, data @ ..]) => Some(fields(data, *order == 6, 4)),
            _ => None,
        }
    }

    pub(super) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let bytes = self.data.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(bytes)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.at = self.at.next_multiple_of(N.min(self.largest_alignment));
        let mut bytes: [u8; N] = self.bytes(N)?.try_into().ok()?;
        if self.is_big_endian {
            bytes.reverse();
        }
        Some(bytes)
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number().map(f64::from_le_bytes)?;
        }
        Some(values)
    }

    /// A list of bytes behind its length.
    pub(super) fn list(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()?;
        self.bytes(usize::try_from(count).ok()?)
    }

    pub(super) fn string(&mut self) -> Option<&'a str> {
        let bytes = self.list()?;
        let bytes = if self.encoding == Encoding::Cdr { bytes.strip_suffix(&[0]).unwrap_or(bytes) } else { bytes };
        std::str::from_utf8(bytes).ok()
    }

    /// The time in a `std_msgs/Header`.
    pub(super) fn header(&mut self) -> Option<Timestamp> {
        if self.encoding == Encoding::Ros1 {
            self.u32()?;
        }
        let (seconds, nanos) = (self.u32()?, self.u32()?);
        self.string()?;
        Some(Timestamp::from_nanos(i64::from(seconds) * 1_000_000_000 + i64::from(nanos)))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn numbers_lie_where_the_encoding_puts_them() {
        // A byte, then a double 1.5 after 7, 3 or 0 bytes of padding.
        let double = 1.5_f64.to_le_bytes();
        let message = |head: &[u8], padding: usize| [head, &[9], &vec![0; padding], &double].concat();
        for (encoding, message) in
            [(Encoding::Ros1, message(&[], 0)), (Encoding::Cdr, message(&[0, 1, 0, 0], 7)), (Encoding::Cdr, message(&[0, 7, 0, 0], 3))]
        {
            let mut fields = Fields::new(encoding, &message).unwrap();
            assert_eq!((fields.u8(), fields.f64s::<1>(), fields.u8()), (Some(9), Some([1.5]), None));
        }
        let big = [&[0, 0, 0, 0, 0, 0, 1, 2][..], &1.5_f64.to_be_bytes()].concat();
        let mut fields = Fields::new(Encoding::Cdr, &big).unwrap();
        assert_eq!((fields.u32(), fields.f64s::<1>()), (Some(258), None));
        assert!(Fields::new(Encoding::Cdr, &[0, 2, 0, 0, 1]).is_none() && Fields::new(Encoding::Cdr, &[0, 1]).is_none());
    }

    #[test]
    fn headers_and_strings_of_both_encodings_read_alike() {
        let ros1 = [&7_u32.to_le_bytes()[..], &5_u32.to_le_bytes(), &6_u32.to_le_bytes(), &3_u32.to_le_bytes(), b"cam"].concat();
        let cdr = [&[0, 1, 0, 0][..], &5_u32.to_le_bytes(), &6_u32.to_le_bytes(), &4_u32.to_le_bytes(), b"cam\0"].concat();
        for (encoding, message) in [(Encoding::Ros1, &ros1), (Encoding::Cdr, &cdr)] {
            assert_eq!(Fields::new(encoding, message).unwrap().header(), Some(Timestamp::from_nanos(5_000_000_006)));
            // Cut off anywhere, it is no header; a length far beyond the end is none either.
            for end in 0..message.len() {
                assert_eq!(Fields::new(encoding, &message[..end]).and_then(|mut fields| fields.header()), None);
            }
        }
        assert_eq!(Fields::new(Encoding::Ros1, &[255, 255, 255, 255, 1]).unwrap().string(), None);
    }
}

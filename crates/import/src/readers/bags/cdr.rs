//! CDR, the encoding of ROS 2 messages. Each field is aligned to its size.
//!
//! The decoder is written by hand, because no maintained crate decodes CDR with types known only at run time.

/// A cursor over the fields of a message.
pub(crate) struct CdrReader<'a> {
    /// The message without its first four bytes, the encapsulation header.
    bytes: &'a [u8],
    offset: usize,
    is_little_endian: bool,
}

impl<'a> CdrReader<'a> {
    /// Starts at the first field; `None` if the encoding is not plain CDR.
    pub(crate) fn new(message: &'a [u8]) -> Option<Self> {
        let (kind, bytes) = message.split_at_checked(4)?;
        let is_little_endian = match kind[..2] {
            [0, 0] => false,
            [0, 1] => true,
            _ => return None,
        };
        Some(Self { bytes, offset: 0, is_little_endian })
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let start = self.offset.next_multiple_of(N);
        let mut bytes: [u8; N] = self.bytes.get(start..start.checked_add(N)?)?.try_into().ok()?;
        self.offset = start + N;
        if !self.is_little_endian {
            bytes.reverse();
        }
        Some(bytes)
    }

    pub(crate) fn i8(&mut self) -> Option<i8> {
        self.number().map(i8::from_le_bytes)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub(crate) fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    /// Reads a sequence of bytes.
    pub(crate) fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()? as usize;
        let bytes = self.bytes.get(self.offset..self.offset.checked_add(length)?)?;
        self.offset += length;
        Some(bytes)
    }

    /// Reads a string, without its final zero byte.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let bytes = self.bytes()?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }

    /// Skips a `std_msgs/Header`: a time and the name of a frame.
    pub(crate) fn header(&mut self) -> Option<()> {
        self.u32()?;
        self.u32()?;
        self.bytes()?;
        Some(())
    }

    /// Reads the bytes of a `std_msgs/UInt8MultiArray` or `ByteMultiArray`. Skips its layout.
    pub(crate) fn array(&mut self) -> Option<&'a [u8]> {
        for _ in 0..self.u32()? {
            self.bytes()?;
            self.u32()?;
            self.u32()?;
        }
        self.u32()?;
        self.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_aligned_to_their_size_in_both_byte_orders() {
        // A string of two characters with its zero byte, two single bytes, and an eight-byte number, aligned to offset
        // 16.
        let mut little = vec![0, 1, 0, 0, 3, 0, 0, 0, b'h', b'i', 0, 7, 9, 0, 0, 0, 0, 0, 0, 0];
        little.extend(1.5f64.to_le_bytes());
        let mut message = CdrReader::new(&little).unwrap();
        assert_eq!((message.text(), message.i8(), message.i8()), (Some("hi"), Some(7), Some(9)));
        assert_eq!((message.f64(), message.i8()), (Some(1.5), None));
        let mut big = vec![0, 0, 0, 0, 0, 0, 0, 3, b'h', b'i', 0, 7, 9, 0, 0, 0, 0, 0, 0, 0];
        big.extend(1.5f64.to_be_bytes());
        let mut message = CdrReader::new(&big).unwrap();
        assert_eq!((message.text(), message.i8(), message.i8()), (Some("hi"), Some(7), Some(9)));
        assert_eq!(message.f64(), Some(1.5));
        assert!(CdrReader::new(&[0, 7, 0, 0]).is_none() && CdrReader::new(&[0, 1]).is_none());
        assert!(CdrReader::new(&[0, 1, 0, 0, 255, 255, 255, 255, 0]).unwrap().bytes().is_none());
    }
}

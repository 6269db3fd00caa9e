//! The bits of an entropy-coded segment.

/// Problem of the data of a scan, without its place.
pub(super) type Problem = &'static str;

pub(super) const EARLY: Problem = "they end early";

/// A reader of bits up to the next marker. A byte FF is followed by a stuffed 00 (T.81, B.1.1.5).
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    /// Position of the next byte to buffer.
    at: usize,
    /// The next bits, from the highest on.
    buffer: u64,
    /// Number of valid bits in the buffer.
    count: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at, buffer: 0, count: 0 }
    }

    /// Position up to which bytes were buffered.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// Returns the next data byte and its length in the file; `None` at a marker or at the end of the file.
    fn next_byte(&self) -> Option<(u8, usize)> {
        let byte = *self.bytes.get(self.at)?;
        if byte != 0xff {
            return Some((byte, 1));
        }
        // Several FF in a row are fill bytes.
        let fill = self.bytes[self.at..].iter().take_while(|b| **b == 0xff).count();
        (self.bytes.get(self.at + fill) == Some(&0)).then_some((0xff, fill + 1))
    }

    fn fill(&mut self) {
        while self.count <= 56 {
            let Some((byte, length)) = self.next_byte() else { return };
            self.buffer |= u64::from(byte) << (56 - self.count);
            self.count += 8;
            self.at += length;
        }
    }

    /// Returns the next 16 bits, with zeros after the end, and how many of them exist.
    pub(super) fn peek(&mut self) -> (u32, u32) {
        if self.count < 16 {
            self.fill();
        }
        ((self.buffer >> 48) as u32, self.count.min(16))
    }

    /// Skips bits that [`Self::peek`] has returned.
    pub(super) fn skip(&mut self, count: u32) {
        self.buffer <<= count;
        self.count -= count;
    }

    /// Takes up to 16 bits.
    pub(super) fn take(&mut self, count: u32) -> Result<u32, Problem> {
        let (bits, there) = self.peek();
        if there < count {
            return Err(EARLY);
        }
        self.skip(count);
        Ok(if count == 0 { 0 } else { bits >> (16 - count) })
    }

    /// Ends the data at the next marker: returns the whole bytes that were not used, and the marker's position.
    pub(super) fn finish(mut self) -> (Vec<u8>, usize) {
        self.buffer <<= self.count % 8;
        let mut unused: Vec<u8> = Vec::new();
        for k in 0..self.count / 8 {
            unused.push((self.buffer >> (56 - 8 * k)) as u8);
        }
        while let Some((byte, length)) = self.next_byte() {
            unused.push(byte);
            self.at += length;
        }
        (unused, self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_taken_up_to_the_marker() {
        let mut bits = Bits::new(&[0xa5, 0xff, 0x00, 0x12, 0x34, 0xff, 0xff, 0xd9], 0);
        assert_eq!(bits.take(4), Ok(0xa));
        assert_eq!(bits.take(12), Ok(0x5ff));
        assert_eq!(bits.take(0), Ok(0));
        assert_eq!(bits.take(3), Ok(0));
        let (unused, at) = bits.finish();
        assert_eq!((unused, at), (vec![0x34], 5));
        let mut bits = Bits::new(&[0x80], 0);
        assert_eq!(bits.take(9), Err(EARLY));
        assert_eq!(bits.peek(), (0x8000, 8));
        // FF at the end of the file, and fill bytes before a stuffed byte.
        assert_eq!(Bits::new(&[0x01, 0xff], 0).finish(), (vec![0x01], 1));
        assert_eq!(Bits::new(&[0xff, 0xff, 0x00, 0x07], 0).finish(), (vec![0xff, 0x07], 4));
    }
}

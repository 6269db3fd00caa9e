//! A scan: its header, and its MCUs with restart markers (T.81, B.2.3 and E.2).

use super::JpegDamage;
use super::bits::{Bits, Problem};
use super::frame::Frame;
use super::huffman::Table;
use super::progressive::{self, Pass};
use super::sequential;

/// Huffman tables by destination, and the quantisation tables that exist.
#[derive(Default)]
pub(super) struct Tables {
    pub(super) dc: [Option<Table>; 4],
    pub(super) ac: [Option<Table>; 4],
    pub(super) has_quantisation: [bool; 4],
}

/// Largest number of blocks in an MCU (T.81, B.2.3).
const MAX_BLOCKS: usize = 10;

/// Largest number of zero bytes that may fill up the data before a marker. Hardware encoders align their data, and
/// libjpeg-turbo buffers up to 8 bytes without a warning.
const MAX_PADDING: usize = 7;

pub(super) struct Scan<'a> {
    /// Number of the scan, from 1, and the place of its header, for errors.
    number: usize,
    /// Index in the frame, DC table and AC table of each component.
    parts: Vec<(usize, usize, usize)>,
    pass: Pass,
    low_bit: u8,
    high_bit: u8,
    tables: &'a Tables,
    restart_interval: usize,
}

impl<'a> Scan<'a> {
    /// Parses the header. An error is the problem of the segment.
    pub(super) fn parse(
        data: &[u8],
        frame: &Frame,
        tables: &'a Tables,
        restart_interval: usize,
        number: usize,
    ) -> Result<Self, Problem> {
        const SHORT: Problem = "its length does not fit its contents";
        let (&count, rest) = data.split_first().ok_or(SHORT)?;
        let count = usize::from(count);
        if !(1..=4).contains(&count) || rest.len() != 2 * count + 3 {
            return Err(SHORT);
        }
        let mut parts: Vec<(usize, usize, usize)> = Vec::new();
        for spec in rest[..2 * count].as_chunks::<2>().0 {
            let index = frame.components.iter().position(|c| c.id == spec[0]);
            let index = index.ok_or("it names a component that the picture lacks")?;
            if parts.iter().any(|(other, ..)| *other == index) {
                return Err("it names a component twice");
            }
            let [dc, ac] = [spec[1] >> 4, spec[1] & 15].map(usize::from);
            if dc > 3 || ac > 3 {
                return Err("it names a table that does not exist");
            }
            parts.push((index, dc, ac));
        }
        let blocks: usize = parts
            .iter()
            .map(|(k, ..)| frame.components[*k].sampling.iter().product::<usize>())
            .sum();
        if count > 1 && blocks > MAX_BLOCKS {
            return Err("its MCUs have more than 10 blocks");
        }
        let [first, last, high, low] = [
            rest[2 * count],
            rest[2 * count + 1],
            rest[2 * count + 2] >> 4,
            rest[2 * count + 2] & 15,
        ];
        let is_valid = if frame.is_progressive {
            let band =
                if first == 0 { last == 0 } else { first <= last && last < 64 && count == 1 };
            band && low <= 13 && (high == 0 || high == low + 1)
        } else {
            (first, last, high, low) == (0, 63, 0, 0)
        };
        if !is_valid {
            return Err("its band of coefficients is invalid");
        }
        let pass = Pass { first: first.into(), last: last.into(), is_first: high == 0 };
        let scan =
            Self { number, parts, pass, low_bit: low, high_bit: high, tables, restart_interval };
        scan.check_tables(frame)?;
        Ok(scan)
    }

    fn check_tables(&self, frame: &Frame) -> Result<(), Problem> {
        let needs_dc = self.pass.first == 0 && self.pass.is_first;
        let needs_ac = !frame.is_progressive || self.pass.first > 0;
        for &(index, dc, ac) in &self.parts {
            let quantisation = usize::from(frame.components[index].quantisation);
            if !self.tables.has_quantisation.get(quantisation).is_some_and(|has| *has) {
                return Err("a quantisation table is missing");
            }
            let dc = self.tables.dc[dc].as_ref();
            if (needs_dc && dc.is_none()) || (needs_ac && self.tables.ac[ac].is_none()) {
                return Err("a Huffman table is missing");
            }
            // T.81, F.1.2.1: a difference of DC coefficients has up to 11 bits; libjpeg allows 15.
            if needs_dc && dc.is_some_and(|table| table.symbols().iter().any(|size| *size > 15)) {
                return Err("a Huffman table of DC coefficients is invalid");
            }
        }
        Ok(())
    }

    /// Notes the bits that the scan delivers, and checks that it continues the scans before it.
    fn progress(&self, frame: &mut Frame) -> Result<(), JpegDamage> {
        let damage = |what| JpegDamage::Progression { scan: self.number, what };
        for (index, ..) in &self.parts {
            let low_bits = &mut frame.components[*index].low_bits;
            if self.pass.first > 0 && low_bits[0].is_none() {
                return Err(damage(
                    "it has AC coefficients, but no scan has their DC coefficients",
                ));
            }
            for low_bit in &mut low_bits[self.pass.first..=self.pass.last] {
                match (self.pass.is_first, *low_bit) {
                    (true, None) => {}
                    (true, Some(_)) => return Err(damage("its coefficients are in a scan before")),
                    (false, Some(bit)) if bit == self.high_bit => {}
                    (false, _) => return Err(damage("it refines coefficients that are missing")),
                }
                *low_bit = Some(self.low_bit);
            }
        }
        Ok(())
    }

    /// Decodes the data from byte `at` on. Returns the position of the next marker.
    pub(super) fn check(
        &self,
        frame: &mut Frame,
        bytes: &[u8],
        at: usize,
    ) -> Result<usize, JpegDamage> {
        self.progress(frame)?;
        let [columns, rows] = match *self.parts.as_slice() {
            [(index, ..)] => frame.components[index].blocks,
            _ => frame.mcus,
        };
        let mut bits = Bits::new(bytes, at);
        let (mut run, mut left, mut restarts) = (0, self.restart_interval, 0u8);
        for mcu in 0..columns * rows {
            if self.restart_interval > 0 && left == 0 {
                let at = self.finish(bits, run)?;
                let expected = 0xd0 + restarts % 8;
                let (marker, at) = marker_at(bytes, at).ok_or(JpegDamage::Cut)?;
                if marker != expected {
                    let what = "a restart marker is missing";
                    return Err(JpegDamage::Data { scan: self.number, at, what });
                }
                bits = Bits::new(bytes, at);
                (run, left, restarts) = (0, self.restart_interval, restarts.wrapping_add(1));
            }
            left = left.saturating_sub(1);
            self.mcu(frame, &mut bits, &mut run, [mcu % columns, mcu / columns])
                .map_err(|what| JpegDamage::Data { scan: self.number, at: bits.at(), what })?;
        }
        self.finish(bits, run)
    }

    fn mcu(
        &self,
        frame: &mut Frame,
        bits: &mut Bits<'_>,
        run: &mut u32,
        [x, y]: [usize; 2],
    ) -> Result<(), Problem> {
        let is_alone = self.parts.len() == 1;
        for &(index, dc, ac) in &self.parts {
            let component = &mut frame.components[index];
            let [across, down] = if is_alone { [1, 1] } else { component.sampling };
            let (dc, ac) = (self.tables.dc[dc].as_ref(), self.tables.ac[ac].as_ref());
            for k in 0..across * down {
                match (frame.is_progressive, dc, ac) {
                    (false, Some(dc), Some(ac)) => sequential::block(bits, dc, ac)?,
                    (true, ..) if self.pass.first == 0 => progressive::dc(bits, self.pass, dc)?,
                    (true, _, Some(ac)) => {
                        let (i, j) = (x * across + k % across, y * down + k / across);
                        let nonzero = &mut component.nonzero[j * component.stride + i];
                        progressive::ac(bits, self.pass, ac, nonzero, run)?;
                    }
                    _ => unreachable!("the tables were checked"),
                }
            }
        }
        Ok(())
    }

    /// Ends the data of a restart interval or of the scan. Returns the position of the marker.
    fn finish(&self, bits: Bits<'_>, run: u32) -> Result<usize, JpegDamage> {
        let (unused, at) = bits.finish();
        let damage = |what| Err(JpegDamage::Data { scan: self.number, at, what });
        if run > 0 {
            return damage("a run of blocks is longer than the scan");
        }
        if unused.len() > MAX_PADDING || unused.iter().any(|byte| *byte != 0) {
            return damage("bytes follow the last block");
        }
        Ok(at)
    }
}

/// Returns the marker at `at`, after fill bytes, and the position behind it.
pub(super) fn marker_at(bytes: &[u8], at: usize) -> Option<(u8, usize)> {
    let fill = bytes.get(at..)?.iter().take_while(|byte| **byte == 0xff).count();
    let marker = *bytes.get(at + fill)?;
    (fill > 0).then_some((marker, at + fill + 1))
}

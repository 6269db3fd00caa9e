//! The markers of a JPEG file and their segments (T.81, B.1.1.3 and B.2.4).

use super::JpegDamage;
use super::bits::Problem;
use super::frame::Frame;
use super::huffman::Table;
use super::scan::{Scan, Tables, marker_at};

/// Returns the contents of the segment whose length is at `at`.
pub(super) fn segment(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = u16::from_be_bytes(*bytes.get(at..)?.first_chunk::<2>()?);
    bytes.get(at + 2..at + usize::from(length))
}

/// What the segments so far have defined.
#[derive(Default)]
struct State {
    frame: Option<Frame>,
    tables: Tables,
    restart_interval: usize,
    scans: usize,
}

/// Checks a whole file, marker by marker.
pub(super) fn check(bytes: &[u8]) -> Result<(), JpegDamage> {
    let mut state = State::default();
    let mut at = 2;
    loop {
        let (marker, after) = next_marker(bytes, at)?;
        let place = after - 2;
        match marker {
            0xd9 => return state.is_complete(),
            // Markers without a segment: restarts and TEM.
            0xd0..=0xd7 | 0x01 => {
                at = after;
                continue;
            }
            0xd8 | 0x02..=0xbf | 0xf0..=0xfd => {
                return Err(JpegDamage::Marker { marker, at: place });
            }
            _ => {}
        }
        let damaged = |what| JpegDamage::Segment { marker, at: place, what };
        let Some(data) = segment(bytes, after) else {
            let is_short = bytes.get(after..after + 2).is_some_and(|length| length < &[0, 2][..]);
            return Err(if is_short { damaged(LENGTH) } else { JpegDamage::Cut });
        };
        at = after + 2 + data.len();
        match marker {
            0xc4 => state.huffman_tables(data).map_err(damaged)?,
            0xdb => state.quantisation_tables(data).map_err(damaged)?,
            0xdd => {
                let interval = data.try_into().map_err(|_| damaged(LENGTH))?;
                state.restart_interval = usize::from(u16::from_be_bytes(interval));
            }
            0xee if data.starts_with(b"Adobe") && data.get(11).is_some_and(|code| *code > 2) => {
                return Err(damaged("its code of the colours is unknown"));
            }
            0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf if state.frame.is_some() => {
                return Err(JpegDamage::Marker { marker, at: place });
            }
            0xc0..=0xc2 => {
                state.frame = Some(Frame::parse(marker == 0xc2, data).ok_or(damaged(CONTENTS))?);
            }
            // Lossless, hierarchical and arithmetic coding, which the decoder refuses by name.
            0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => return Ok(()),
            0xda => {
                let Some(frame) = &mut state.frame else {
                    return Err(JpegDamage::Marker { marker, at: place });
                };
                state.scans += 1;
                let (tables, interval) = (&state.tables, state.restart_interval);
                let scan =
                    Scan::parse(data, frame, tables, interval, state.scans).map_err(damaged)?;
                at = scan.check(frame, bytes, at)?;
            }
            _ => {}
        }
    }
}

const LENGTH: Problem = "its length does not fit its contents";
const CONTENTS: Problem = "its contents are invalid";

/// Returns the next marker and the position behind it. Only fill bytes may stand before it.
fn next_marker(bytes: &[u8], at: usize) -> Result<(u8, usize), JpegDamage> {
    let rest = bytes.get(at..).unwrap_or_default();
    let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff);
    let count = match rest.first() {
        Some(0xff) => 0,
        _ => rest.windows(2).position(is_marker).ok_or(JpegDamage::Cut)?,
    };
    let (marker, after) = marker_at(bytes, at + count).ok_or(JpegDamage::Cut)?;
    // A stuffed byte outside of data is as extraneous as any other byte.
    let count = count + usize::from(marker == 0);
    if count > 0 {
        return Err(JpegDamage::Extraneous { count, marker, at: after - 2 });
    }
    Ok((marker, after))
}

impl State {
    fn huffman_tables(&mut self, mut data: &[u8]) -> Result<(), Problem> {
        while let Some((&class_and_place, rest)) = data.split_first() {
            let (&counts, rest) = rest.split_first_chunk::<16>().ok_or(LENGTH)?;
            let count: usize = counts.iter().map(|n| usize::from(*n)).sum();
            let symbols = rest.get(..count).filter(|_| count <= 256).ok_or(LENGTH)?;
            data = &rest[count..];
            let place = usize::from(class_and_place & 15);
            let tables = match class_and_place >> 4 {
                0 => &mut self.tables.dc,
                1 => &mut self.tables.ac,
                _ => return Err(CONTENTS),
            };
            let table = Table::new(counts, symbols).ok_or("its codes are no Huffman code")?;
            *tables.get_mut(place).ok_or(CONTENTS)? = Some(table);
        }
        Ok(())
    }

    fn quantisation_tables(&mut self, mut data: &[u8]) -> Result<(), Problem> {
        while let Some((&precision_and_place, rest)) = data.split_first() {
            let length = if precision_and_place >> 4 == 0 { 64 } else { 128 };
            data = rest.get(length..).ok_or(LENGTH)?;
            let place = usize::from(precision_and_place & 15);
            *self.tables.has_quantisation.get_mut(place).ok_or(CONTENTS)? = true;
        }
        Ok(())
    }

    /// Checks that the scans hold all bits of all coefficients.
    fn is_complete(&self) -> Result<(), JpegDamage> {
        let Some(frame) = &self.frame else {
            return Err(JpegDamage::Cut);
        };
        for component in &frame.components {
            let missing = |what| JpegDamage::Incomplete { component: component.id, what };
            let [first, rest @ ..] = &component.low_bits;
            match first {
                Some(0) => {}
                Some(_) => return Err(missing("the last bit of the DC coefficients")),
                None => return Err(missing("every coefficient")),
            }
            if rest.contains(&None) {
                return Err(missing("a part of the AC coefficients"));
            }
            if rest.iter().any(|bit| *bit != Some(0)) {
                return Err(missing("the last bit of a part of the AC coefficients"));
            }
        }
        Ok(())
    }
}

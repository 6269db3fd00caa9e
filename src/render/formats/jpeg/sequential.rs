//! The blocks of sequential scans (T.81, F.2.2).

use super::bits::{Bits, Problem};
use super::huffman::Table;

pub(super) const BEYOND: Problem = "a block has more than 64 coefficients";

/// Decodes a block of 64 coefficients.
pub(super) fn block(bits: &mut Bits<'_>, dc: &Table, ac: &Table) -> Result<(), Problem> {
    let size = dc.decode(bits)?;
    bits.take(u32::from(size))?;
    let mut k = 1;
    while k < 64 {
        let symbol = ac.decode(bits)?;
        let (run, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
        match (run, size) {
            (0, 0) => return Ok(()),
            (15, 0) => k += 16,
            (_, 0) => return Err("a code has no meaning"),
            _ => {
                k += run + 1;
                bits.take(size)?;
            }
        }
        if k > 64 {
            return Err(BEYOND);
        }
    }
    Ok(())
}

//! The blocks of progressive scans (T.81, annex G).

use super::bits::{Bits, Problem};
use super::huffman::Table;
use super::sequential::BEYOND;

/// Band and bits of a progressive scan.
#[derive(Clone, Copy)]
pub(super) struct Pass {
    /// First and last coefficient, in zigzag order.
    pub(super) first: usize,
    pub(super) last: usize,
    /// True for the first scan of these coefficients, false for a scan that refines them by a bit.
    pub(super) is_first: bool,
}

/// Decodes the DC coefficient of a block.
pub(super) fn dc(bits: &mut Bits<'_>, pass: Pass, table: Option<&Table>) -> Result<(), Problem> {
    match table {
        Some(table) if pass.is_first => {
            let size = table.decode(bits)?;
            bits.take(u32::from(size))?;
        }
        _ => drop(bits.take(1)?),
    }
    Ok(())
}

/// Decodes the AC coefficients of a block. `nonzero` has a bit for each coefficient that is not 0. `run` is the number of
/// blocks, this one included, without new coefficients.
pub(super) fn ac(
    bits: &mut Bits<'_>,
    pass: Pass,
    table: &Table,
    nonzero: &mut u64,
    run: &mut u32,
) -> Result<(), Problem> {
    let mut k = pass.first;
    while *run == 0 && k <= pass.last {
        let symbol = table.decode(bits)?;
        let (zeros, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) + bits.take(zeros as u32)?;
            break;
        }
        if pass.is_first {
            bits.take(size)?;
            k += zeros;
        } else {
            if size > 1 {
                return Err("a code has no meaning");
            }
            bits.take(size)?;
            k = skip_zeros(bits, pass, *nonzero, k, zeros)?;
        }
        if size > 0 {
            if k > pass.last {
                return Err(BEYOND);
            }
            *nonzero |= 1 << k;
        }
        k += 1;
    }
    if *run > 0 {
        if !pass.is_first {
            for k in k..=pass.last {
                bits.take(((*nonzero >> k) & 1) as u32)?;
            }
        }
        *run -= 1;
    }
    Ok(())
}

/// Passes `zeros` coefficients that are 0, and refines the others between them. Returns the position of the next
/// coefficient that is 0, or the end of the band.
fn skip_zeros(
    bits: &mut Bits<'_>,
    pass: Pass,
    nonzero: u64,
    first: usize,
    mut zeros: usize,
) -> Result<usize, Problem> {
    for k in first..=pass.last {
        if (nonzero >> k) & 1 == 1 {
            bits.take(1)?;
        } else if zeros == 0 {
            return Ok(k);
        } else {
            zeros -= 1;
        }
    }
    Ok(pass.last + 1)
}

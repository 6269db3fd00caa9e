//! Transfer functions from coded values to linear Rec.709 radiance.

use glasshouse_line::Transfer;
use glasshouse_line::color::decode_srgb;
use std::sync::LazyLock;

/// Returns the radiance of a coded value.
pub(super) fn to_linear(transfer: Transfer, coded: f64) -> f64 {
    match transfer {
        Transfer::Srgb => decode_srgb(coded),
        Transfer::Linear => coded,
    }
}

/// Largest float that the curve of sRGB is meant for, with room for highlights above white. Larger ones are codes of
/// another range, such as 0 to 255, or linear light.
const MOST_CODED: f32 = 2.0;

/// Checks that floats are in the range that `transfer` is defined for. An error says what they are.
pub(super) fn check_range(transfer: Transfer, values: &[f32]) -> Result<(), String> {
    let finite = values.iter().copied().filter(|value| value.is_finite());
    let most = finite.fold(0.0, f32::max);
    if transfer == Transfer::Linear || most <= MOST_CODED {
        return Ok(());
    }
    Err(format!("floats of up to {most}, a range that \"transfer\": \"srgb\" does not have"))
}

/// Linear values of the 16-bit sRGB codes. The powers take milliseconds, so a process computes them once.
static SRGB_16: LazyLock<Vec<f64>> =
    LazyLock::new(|| (0..=u16::MAX).map(|code| decode_srgb(code as f64 / 65535.0)).collect());

/// Makes the tables that would otherwise be made at their first use. A process calls this before it starts threads if it
/// may fork later: a child that is forked while a thread makes a table would wait for that thread for ever.
pub fn prepare() {
    LazyLock::force(&SRGB_16);
}

/// Returns the radiance of each 8-bit code, times `exposure`.
pub(super) fn table_8(transfer: Transfer, exposure: f64) -> Vec<f32> {
    (0..=u8::MAX).map(|code| (to_linear(transfer, code as f64 / 255.0) * exposure) as f32).collect()
}

/// Returns the radiance of each 16-bit code, times `exposure`.
pub(super) fn table_16(transfer: Transfer, exposure: f64) -> Vec<f32> {
    match transfer {
        Transfer::Srgb => SRGB_16.iter().map(|linear| (linear * exposure) as f32).collect(),
        Transfer::Linear => {
            (0..=u16::MAX).map(|code| (code as f64 / 65535.0 * exposure) as f32).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_floats_near_0_to_1_are_coded() {
        let srgb = |values: &[f32]| check_range(Transfer::Srgb, values);
        for values in [&[][..], &[-3.0, 0.0, 1.0], &[2.0, f32::NAN, f32::INFINITY]] {
            assert_eq!(srgb(values), Ok(()));
        }
        for most in [2.5, 255.0, 65535.0] {
            assert!(srgb(&[0.0, most, f32::NAN]).unwrap_err().contains(&format!("up to {most},")));
            assert_eq!(check_range(Transfer::Linear, &[most]), Ok(()));
        }
    }

    #[test]
    fn tables_rise_from_0_to_the_exposure_and_agree() {
        for transfer in [Transfer::Srgb, Transfer::Linear] {
            let (small, large) = (table_8(transfer, 2.5), table_16(transfer, 2.5));
            assert_eq!((small.len(), large.len()), (256, 65536));
            for table in [&small, &large] {
                assert!(table.is_sorted_by(|a, b| a < b));
                assert_eq!((table[0], table[table.len() - 1]), (0.0, 2.5));
            }
            // 255 * 257 = 65535, so every 8-bit code is also a 16-bit code.
            for code in 0..256 {
                assert_eq!(small[code], large[code * 257]);
            }
        }
    }
}

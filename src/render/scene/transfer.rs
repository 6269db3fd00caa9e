//! Transfer curves: from coded values to linear Rec.709 radiance.

use crate::line::Transfer;
use std::sync::LazyLock;

/// Inverse of the sRGB curve (IEC 61966-2-1), continued above 1; negative values and NaN stay so.
///
/// Through `libm`, whose bits do not depend on the machine, unlike `f64::powf`'s.
pub(super) fn srgb_to_linear(coded: f64) -> f64 {
    if coded > 0.04045 {
        libm::pow((coded + 0.055) / 1.055, 2.4)
    } else {
        coded / 12.92
    }
}

/// The radiance of a coded value.
pub(super) fn to_linear(transfer: Transfer, coded: f64) -> f64 {
    match transfer {
        Transfer::Srgb => srgb_to_linear(coded),
        Transfer::Linear => coded,
    }
}

/// 65,536 powers cost milliseconds: once a process is enough.
static SRGB_16: LazyLock<Vec<f64>> = LazyLock::new(|| {
    (0..=u16::MAX)
        .map(|code| srgb_to_linear(code as f64 / 65535.0))
        .collect()
});

/// Radiance of each 8-bit code, times `exposure`.
pub(super) fn table_8(transfer: Transfer, exposure: f64) -> Vec<f32> {
    (0..=u8::MAX)
        .map(|code| (to_linear(transfer, code as f64 / 255.0) * exposure) as f32)
        .collect()
}

/// Radiance of each 16-bit code, times `exposure`.
pub(super) fn table_16(transfer: Transfer, exposure: f64) -> Vec<f32> {
    match transfer {
        Transfer::Srgb => SRGB_16
            .iter()
            .map(|linear| (linear * exposure) as f32)
            .collect(),
        Transfer::Linear => (0..=u16::MAX)
            .map(|code| (code as f64 / 65535.0 * exposure) as f32)
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // 128/255 and 188/255, to 12 digits from the standard's formula in exact arithmetic.
        assert!((srgb_to_linear(128.0 / 255.0) - 0.215860500114).abs() < 1e-12);
        assert!((srgb_to_linear(188.0 / 255.0) - 0.502886458033).abs() < 1e-12);
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert_eq!(srgb_to_linear(1.0), 1.0);
        assert!(srgb_to_linear(f64::NAN).is_nan());
        assert!(srgb_to_linear(-1.0) < 0.0);
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
            // 255 * 257 = 65535: every 8-bit code is also a 16-bit one.
            for code in 0..256 {
                assert_eq!(small[code], large[code * 257]);
            }
        }
    }
}

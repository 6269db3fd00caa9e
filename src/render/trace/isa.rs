//! Instruction sets of the kernels.

/// Instruction set of the kernels. All instruction sets yield the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// The baseline of the architecture (SSE2 on x86-64).
    Baseline,
    /// 256-bit vectors.
    Avx2,
    /// 512-bit vectors: AVX-512 F, VL, DQ and BW.
    Avx512,
}

/// Number of [`Isa::Baseline`], for functions that are compiled for each instruction set.
pub(super) const BASELINE: u8 = Isa::Baseline as u8;
/// Number of [`Isa::Avx2`].
pub(super) const AVX2: u8 = Isa::Avx2 as u8;
/// Number of [`Isa::Avx512`].
pub(super) const AVX512: u8 = Isa::Avx512 as u8;

impl Isa {
    /// All instruction sets, from the slowest to the fastest.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// True if this machine has the instruction set.
    pub fn is_available(self) -> bool {
        match self {
            Self::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => std::arch::is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && std::arch::is_x86_feature_detected!("avx512f")
                    && std::arch::is_x86_feature_detected!("avx512vl")
                    && std::arch::is_x86_feature_detected!("avx512dq")
                    && std::arch::is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Returns the instruction set with this number.
    pub(super) const fn numbered(number: u8) -> Self {
        match number {
            AVX512 => Self::Avx512,
            AVX2 => Self::Avx2,
            _ => Self::Baseline,
        }
    }

    /// Detects the fastest instruction set of this machine.
    pub fn detect() -> Self {
        let mut fastest = Self::ALL.into_iter().rev();
        fastest.find(|isa| isa.is_available()).unwrap_or(Self::Baseline)
    }

    /// Returns the lower-case name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

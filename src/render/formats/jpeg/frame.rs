//! The frame of a JPEG: its components, and what the scans have delivered of them.

/// A colour component.
pub(super) struct Component {
    pub(super) id: u8,
    /// Sampling factors, horizontal and vertical, 1 to 4.
    pub(super) sampling: [usize; 2],
    pub(super) quantisation: u8,
    /// Blocks in a row, and rows of blocks, in scans of this component alone.
    pub(super) blocks: [usize; 2],
    /// Blocks in a row of whole MCUs.
    pub(super) stride: usize,
    /// For each coefficient in zigzag order: the lowest bit that scans have delivered; none before the first scan.
    pub(super) low_bits: [Option<u8>; 64],
    /// For each block, with whole MCUs: bit k is set if coefficient k is not 0. Empty in sequential frames.
    pub(super) nonzero: Vec<u64>,
}

/// The picture's size and components (T.81, B.2.2).
pub(super) struct Frame {
    pub(super) is_progressive: bool,
    pub(super) components: Vec<Component>,
    /// MCUs in a row, and rows of MCUs, in scans of several components.
    pub(super) mcus: [usize; 2],
}

impl Frame {
    /// Parses the segment of SOF0, SOF1 or SOF2. Returns `None` if it is damaged, or of a kind that no decoder reads.
    pub(super) fn parse(is_progressive: bool, data: &[u8]) -> Option<Self> {
        let (&[precision, h1, h0, w1, w0, count], rest) = data.split_first_chunk::<6>()?;
        let [width, height] = [[w1, w0], [h1, h0]].map(|b| usize::from(u16::from_be_bytes(b)));
        let specs = rest.as_chunks::<3>().0;
        let is_sound = precision == 8
            && width > 0
            && height > 0
            && rest.len() == 3 * usize::from(count)
            && matches!(count, 1..=4);
        if !is_sound {
            return None;
        }
        let sampling_of = |spec: &[u8; 3]| [spec[1] >> 4, spec[1] & 15].map(usize::from);
        if !specs.iter().flat_map(sampling_of).all(|factor| (1..=4).contains(&factor)) {
            return None;
        }
        let most = [0, 1].map(|axis| specs.iter().map(|s| sampling_of(s)[axis]).max().unwrap_or(1));
        let size = [width, height];
        let mcus = [0, 1].map(|axis| size[axis].div_ceil(8 * most[axis]));
        let component = |spec: &[u8; 3]| {
            let sampling = sampling_of(spec);
            let of_axis =
                |axis: usize| (size[axis] * sampling[axis]).div_ceil(most[axis]).div_ceil(8);
            let whole = [0, 1].map(|axis| mcus[axis] * sampling[axis]);
            Component {
                id: spec[0],
                sampling,
                quantisation: spec[2],
                blocks: [of_axis(0), of_axis(1)],
                stride: whole[0],
                low_bits: [None; 64],
                nonzero: vec![0; if is_progressive { whole[0] * whole[1] } else { 0 }],
            }
        };
        Some(Self { is_progressive, components: specs.iter().map(component).collect(), mcus })
    }
}

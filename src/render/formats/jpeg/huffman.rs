//! Huffman tables (T.81, annex C and F.2.2.3).

use super::bits::{Bits, EARLY, Problem};

/// Length of the codes that [`Table::fast`] decodes at once, bits.
const FAST_BITS: u32 = 9;

#[derive(Clone)]
pub(super) struct Table {
    /// By the first bits: (length of the code, symbol); length 0 for longer codes.
    fast: Vec<(u8, u8)>,
    /// For each length: the end of its codes, aligned to 16 bits, and the number that maps a code to its symbol.
    ends: [(u32, i32); 17],
    symbols: Vec<u8>,
}

impl Table {
    /// Makes a table from the numbers of codes with 1 to 16 bits and their symbols. Returns `None` if they are no code.
    pub(super) fn new(counts: [u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut fast = vec![(0, 0); 1 << FAST_BITS];
        let mut ends = [(0, 0); 17];
        let (mut code, mut index) = (0u32, 0usize);
        for length in 1..=16u32 {
            let count = usize::from(counts[length as usize - 1]);
            ends[length as usize].1 = index as i32 - code as i32;
            for &symbol in symbols.get(index..index + count)? {
                if code >= 1 << length {
                    return None;
                }
                if length <= FAST_BITS {
                    let first = (code << (FAST_BITS - length)) as usize;
                    fast[first..first + (1 << (FAST_BITS - length))].fill((length as u8, symbol));
                }
                code += 1;
            }
            index += count;
            ends[length as usize].0 = code << (16 - length);
            code <<= 1;
        }
        (index == symbols.len()).then(|| Self { fast, ends, symbols: symbols.to_vec() })
    }

    pub(super) fn symbols(&self) -> &[u8] {
        &self.symbols
    }

    /// Decodes the next symbol.
    pub(super) fn decode(&self, bits: &mut Bits<'_>) -> Result<u8, Problem> {
        let (next, there) = bits.peek();
        let (length, symbol) = self.fast[(next >> (16 - FAST_BITS)) as usize];
        let (length, symbol) = if length > 0 {
            (u32::from(length), symbol)
        } else {
            let is_of = |length: &u32| next < self.ends[*length as usize].0;
            let Some(length) = (FAST_BITS + 1..=16).find(is_of) else {
                return Err(if there < 16 { EARLY } else { "a code is in no Huffman table" });
            };
            let code = (next >> (16 - length)) as i32;
            (length, self.symbols[(code + self.ends[length as usize].1) as usize])
        };
        if there < length {
            return Err(EARLY);
        }
        bits.skip(length);
        Ok(symbol)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of T.81, K.3.1 (luminance DC).
    #[test]
    fn codes_of_the_standard_are_decoded() {
        let counts = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
        let symbols: Vec<u8> = (0..12).collect();
        let table = Table::new(counts, &symbols).unwrap();
        // 00 -> 0, 010 -> 1, 1110 -> 6, 1111 1111 0 -> 11.
        let mut bits = Bits::new(&[0b0001_0111, 0b0111_1111, 0b1000_0000], 0);
        let found: Vec<_> = (0..4).map(|_| table.decode(&mut bits)).collect();
        assert_eq!(found, [Ok(0), Ok(1), Ok(6), Ok(11)]);
        let mut bits = Bits::new(&[0xff, 0x00, 0xff, 0x00], 0);
        assert_eq!(table.decode(&mut bits), Err("a code is in no Huffman table"));
        assert_eq!(table.decode(&mut Bits::new(&[0xff, 0x00], 0)), Err(EARLY));
        assert!(Table::new([3; 16], &[0; 48]).is_none());
        assert!(Table::new(counts, &symbols[1..]).is_none());
    }

    #[test]
    fn long_codes_are_decoded() {
        // One code of each length 1 to 16: n - 1 ones and a zero.
        let symbols: Vec<u8> = (1..=16).collect();
        let table = Table::new([1; 16], &symbols).unwrap();
        for length in 1..=16u32 {
            let code = ((1u32 << length) - 2) << (16 - length);
            let bytes: Vec<u8> = [(code >> 8) as u8, code as u8]
                .into_iter()
                .flat_map(|b| if b == 0xff { vec![0xff, 0] } else { vec![b] })
                .collect();
            assert_eq!(table.decode(&mut Bits::new(&bytes, 0)), Ok(length as u8));
        }
    }
}

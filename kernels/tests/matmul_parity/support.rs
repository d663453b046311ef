//! What the cases are made of and held to: numbers, guarded outputs, and the back-ends of this processor.

use proptest::prelude::*;
use umo_kernels::{Isa, MatMut};

/// Elements on either side of an output that nothing may touch.
const GUARD: usize = 64;
const CANARY: f32 = f32::from_bits(0x7fc5_a5a5);

/// The back-end of this name; `None`, said aloud, where the processor lacks it, and a failure where the environment
/// says that it must not.
pub(crate) fn isa(name: &str) -> Option<Isa> {
    let found = Isa::from_name(name);
    if found.is_none() {
        let required = std::env::var("UMO_TEST_REQUIRE").unwrap_or_default();
        assert!(!required.split(',').any(|required| required == name), "this processor lacks the required {name}");
        println!("SKIPPED: this processor lacks {name}");
    }
    found
}

macro_rules! for_each_isa {
    ($check:ident => $($isa:ident),+) => {
        mod $check {
            $(#[test]
            fn $isa() {
                if let Some(isa) = super::isa(stringify!($isa)) {
                    super::$check(isa);
                }
            })+
        }
    };
}

/// Values at `offset` elements behind a cache line's start, so that an offset of 0 is an aligned one.
pub(crate) struct Shifted<T> {
    data: Vec<T>,
    start: usize,
    len: usize,
}

/// Bytes of a cache line.
const LINE: usize = 64;

impl<T: Copy + Default> Shifted<T> {
    pub(crate) fn new(values: &[T], offset: usize) -> Self {
        let mut data = vec![T::default(); offset + LINE + values.len()];
        let start = data.as_ptr().align_offset(LINE) + offset;
        data[start..start + values.len()].copy_from_slice(values);
        Self { data, start, len: values.len() }
    }

    pub(crate) fn get(&self) -> &[T] {
        &self.data[self.start..self.start + self.len]
    }
}

/// An output between canaries, and rows further apart than they are long.
pub(crate) struct Guarded {
    data: Vec<f32>,
    start: usize,
    shape: (usize, usize, usize),
}

impl Guarded {
    pub(crate) fn new(rows: usize, cols: usize, gap: usize, offset: usize, old: f32) -> Self {
        let (stride, start) = (cols + gap, GUARD + offset);
        let mut data = vec![CANARY; start + rows * stride + GUARD];
        for row in 0..rows {
            data[start + row * stride..][..cols].fill(old);
        }
        Self { data, start, shape: (rows, cols, stride) }
    }

    pub(crate) fn view(&mut self) -> MatMut<'_, f32> {
        let (rows, cols, stride) = self.shape;
        let end = self.data.len() - GUARD;
        MatMut::with_stride(&mut self.data[self.start..end], rows, cols, stride).unwrap()
    }

    /// Bits of the rows, after a look at every canary.
    pub(crate) fn bits(&self) -> Vec<Vec<u32>> {
        let (rows, cols, stride) = self.shape;
        let inside = |i: usize| i >= self.start && i < self.start + rows * stride && (i - self.start) % stride < cols;
        for (i, value) in self.data.iter().enumerate() {
            assert!(inside(i) || value.to_bits() == CANARY.to_bits(), "canary {i} overwritten");
        }
        (0..rows)
            .map(|row| self.data[self.start + row * stride..][..cols].iter().map(|v| v.to_bits()).collect())
            .collect()
    }
}

/// Numbers from a counter, so that a case is small to print: splitmix64.
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub(crate) fn step(&mut self) -> i8 {
        (self.next() >> 56) as u8 as i8
    }

    /// An integer of at most 16.
    pub(crate) fn integer(&mut self) -> f32 {
        self.below(33) as f32 - 16.0
    }

    pub(crate) fn real(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// `count * tile + {-1, 0, 1}`.
pub(crate) fn near(tile: usize, most: usize) -> impl Strategy<Value = usize> {
    (0..=most, 0_usize..3).prop_map(move |(count, around)| (count * tile + around).saturating_sub(1))
}

pub(crate) fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

pub(crate) use for_each_isa;

//! What the kernel tests share: one test per instruction set, guarded buffers, and inputs that seek
//! out edges.
//!
//! A property takes an [`Isa`]; [`for_each_isa!`] makes one test of it per back-end, with the
//! back-end in the test's name. A processor that lacks a back-end prints `SKIPPED`, unless the
//! environment variable `UMO_TEST_REQUIRE` (names with commas between) demands it: then the test
//! fails.

#[path = "pages.rs"]
pub mod pages;

use std::fmt::Debug;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

use proptest::prelude::*;
use umo_kernels::{Isa, Mat, MatMut};

/// Elements of canary on each side of a [`Guarded`] buffer.
pub const GUARD: usize = 64;

/// Tells a test's other threads to end, also where the test fails: a scope waits for them.
pub struct Ends<'a>(pub &'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

/// One test per instruction set of this target for each property: `for_each_isa!(softmax_is_exact =>
/// every);` makes the tests `softmax_is_exact::scalar`, `softmax_is_exact::avx2` and so on. For
/// `vector`, `scalar` is left out.
#[macro_export]
macro_rules! for_each_isa {
    ($($property:ident),+ => $isas:ident) => {
        $(
            mod $property {
                $crate::for_each_isa!(@$isas $property);
            }
        )+
    };
    (@every $property:ident) => {
        $crate::for_each_isa!(@tests $property scalar);
        $crate::for_each_isa!(@vector $property);
    };
    (@vector $property:ident) => {
        #[cfg(target_arch = "x86_64")]
        $crate::for_each_isa!(@tests $property avx2 avxvnni avx512vnni avx512bf16 amx);
        #[cfg(target_arch = "aarch64")]
        $crate::for_each_isa!(@tests $property neon neon_dotprod neon_i8mm);
        #[cfg(target_arch = "wasm32")]
        $crate::for_each_isa!(@tests $property simd128);
    };
    (@tests $property:ident $($isa:ident)+) => {
        $(
            #[test]
            fn $isa() {
                $crate::on_isa(stringify!($isa), super::$property);
            }
        )+
    };
}

/// Runs `property` on the back-end of this name, or skips it as the module says.
pub fn on_isa(name: &str, property: impl FnOnce(Isa)) {
    match Isa::from_name(name) {
        Some(isa) => property(isa),
        None if required().iter().any(|required| required == name) => {
            panic!("UMO_TEST_REQUIRE names {name}, which this processor does not have")
        }
        None => {
            // Not `eprintln!`, whose text libtest keeps to itself when a test passes.
            writeln!(std::io::stderr(), "SKIPPED: this processor does not have {name}")
                .expect("standard error is open");
        }
    }
}

/// The names in `UMO_TEST_REQUIRE`.
pub fn required() -> Vec<String> {
    let names = std::env::var("UMO_TEST_REQUIRE").unwrap_or_default();
    names.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

/// Sizes `n * tile + {-1, 0, 1}` for `n` up to `most`, with 0 and 1 among them.
pub fn near(tile: usize, most: usize) -> impl Strategy<Value = usize> {
    (0..=most, 0..3_usize).prop_map(move |(n, more)| (n * tile + more).saturating_sub(1))
}

/// Sizes around whole multiples of these: as often the multiple itself as one less or one more, up
/// to twelve of it, and now and then any remainder or nothing at all.
pub fn around(tiles: &'static [usize]) -> impl Strategy<Value = usize> {
    let count = prop_oneof![4 => 1..=2_usize, 3 => 3..=5_usize, 1 => 6..=12_usize];
    (prop::sample::select(tiles), count).prop_flat_map(|(tile, count)| {
        let size = tile * count;
        prop_oneof![20 => Just(size), 9 => Just(size - 1), 9 => Just(size + 1), 9 => 1..=size + tile, 1 => Just(0)]
    })
}

/// Where a slice starts behind a cache line's start, in elements.
pub fn offset() -> impl Strategy<Value = usize> {
    0..64_usize
}

/// A small generator (SplitMix64): proptest shrinks its seed and the sizes, not thousands of single
/// values.
#[derive(Clone, Debug)]
pub struct Noise(u64);

impl Noise {
    /// The stream of this seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }

    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        usize::try_from(self.bits() % end as u64).expect("a remainder of a usize fits one")
    }

    /// Any int8.
    pub fn code(&mut self) -> i8 {
        self.bits().to_le_bytes()[0].cast_signed()
    }

    /// A number in `-size..size`.
    pub fn float(&mut self, size: f32) -> f32 {
        let unit = u32::try_from(self.bits() >> 40).expect("24 bits") as f32 / 8_388_608.0;
        (unit - 1.0) * size
    }

    /// An integer in `-size..=size` as a float.
    pub fn integer(&mut self, size: i16) -> f32 {
        let count = 2 * usize::from(size.unsigned_abs()) + 1;
        f32::from(i16::try_from(self.below(count)).expect("small") - size)
    }
}

/// The kinds of values that inputs are made of.
#[derive(Clone, Copy, Debug)]
pub enum Fill {
    /// Uniform in `-size..size`.
    Uniform(f32),
    /// Integers in `-size..=size`: sums of their products are exact in f32.
    Integer(i16),
    /// Mostly small, with a few values a thousand times larger, as in transformers' outlier
    /// channels.
    Outliers,
    /// One value everywhere.
    Constant(f32),
    /// Values so small that their squares are denormal or zero.
    Tiny,
}

impl Fill {
    /// One value.
    pub fn next(self, noise: &mut Noise) -> f32 {
        match self {
            Self::Uniform(size) => noise.float(size),
            Self::Integer(size) => noise.integer(size),
            Self::Outliers if noise.below(50) == 0 => noise.float(1000.0),
            Self::Outliers => noise.float(1.0),
            Self::Constant(value) => value,
            Self::Tiny => noise.float(1e-20),
        }
    }
}

/// Every kind of values for operations whose tolerance scales with them.
pub fn fill() -> impl Strategy<Value = Fill> {
    prop_oneof![
        4 => Just(Fill::Uniform(1.0)),
        1 => Just(Fill::Uniform(30.0)),
        1 => Just(Fill::Integer(16)),
        2 => Just(Fill::Outliers),
        1 => (-3_i8..=3).prop_map(|value| Fill::Constant(f32::from(value))),
        1 => Just(Fill::Tiny),
    ]
}

/// Bytes of a cache line.
pub const LINE: usize = 64;

/// A row-major input of any stride whose first element is `offset` elements behind the start of a
/// cache line, and whose last is the last of its allocation, so that a read beyond it is a read
/// beyond the heap block.
#[derive(Debug)]
pub struct Placed<T> {
    data: Vec<T>,
    start: usize,
    offset: usize,
    rows: usize,
    cols: usize,
    stride: usize,
}

impl<T: Copy + Default> Placed<T> {
    /// `[rows, cols]` of values from `next`, rows `cols + gap` apart; what is between them is from
    /// `next` too.
    pub fn new(rows: usize, cols: usize, gap: usize, offset: usize, mut next: impl FnMut() -> T) -> Self {
        let stride = cols + gap;
        let len = if rows == 0 { 0 } else { (rows - 1) * stride + cols };
        let (mut data, start) = allocate(offset, len);
        data.resize(start, T::default());
        data.extend((0..len).map(|_| next()));
        Self { data, start, offset, rows, cols, stride }
    }

    /// One row of these values.
    pub fn copy_of(values: &[T], offset: usize) -> Self {
        let mut values = values.iter();
        Self::new(1, values.len(), 0, offset, || *values.next().expect("as many as there are"))
    }

    /// The matrix.
    pub fn mat(&self) -> Mat<'_, T> {
        Mat::with_stride(&self.data[self.start..], self.rows, self.cols, self.stride).expect("sized by new")
    }

    /// All elements, with what is between rows.
    pub fn elements(&self) -> &[T] {
        &self.data[self.start..]
    }

    /// All of a one-row input.
    pub fn row(&self) -> &[T] {
        if self.rows == 0 { &[] } else { self.mat().row(0) }
    }
}

impl<T: Copy + Default> Clone for Placed<T> {
    fn clone(&self) -> Self {
        let mut elements = self.elements().iter();
        let next = || *elements.next().expect("as many as there are");
        Self::new(self.rows, self.cols, self.stride - self.cols, self.offset, next)
    }
}

/// An empty vector, and where to start in it, `offset` elements behind a cache line's start, for
/// `len` elements to end where the allocation does. Where the next allocation starts is not known
/// before: the place of one of this size is tried for another. Should none of them fit, some room
/// is left behind the end.
fn allocate<T>(offset: usize, len: usize) -> (Vec<T>, usize) {
    let (mut tried, mut front) = (vec![], 0);
    for _ in 0..16 {
        let data: Vec<T> = Vec::with_capacity(front + offset + len);
        let found = data.as_ptr().align_offset(LINE);
        if found == front {
            return (data, front + offset);
        }
        front = found;
        tried.push(data);
    }
    let data: Vec<T> = Vec::with_capacity(LINE / size_of::<T>() + offset + len);
    let start = data.as_ptr().align_offset(LINE) + offset;
    (data, start)
}

/// A type with a value that no kernel writes by chance.
pub trait Canary: Copy + PartialEq + Debug {
    /// That value.
    const CANARY: Self;
}

impl Canary for f32 {
    const CANARY: Self = -6.660_123e33;
}
impl Canary for f64 {
    const CANARY: Self = -6.660_123_456_789e233;
}
impl Canary for i8 {
    const CANARY: Self = -91;
}
impl Canary for u32 {
    const CANARY: Self = 0xdead_beef;
}

/// An output matrix with [`GUARD`] canaries on each side and in the gaps between rows.
#[derive(Clone, Debug)]
pub struct Guarded<T> {
    data: Vec<T>,
    offset: usize,
    rows: usize,
    cols: usize,
    stride: usize,
}

impl<T: Canary> Guarded<T> {
    /// `[rows, cols]`, rows `cols + gap` apart, all canaries; it starts `offset` elements after the
    /// first guard.
    pub fn new(rows: usize, cols: usize, gap: usize, offset: usize) -> Self {
        let stride = cols + gap;
        Self { data: vec![T::CANARY; GUARD + offset + rows * stride + GUARD], offset, rows, cols, stride }
    }

    /// The same with `value` in all its rows, for operations that add to them.
    pub fn filled(rows: usize, cols: usize, gap: usize, offset: usize, value: T) -> Self {
        let mut filled = Self::new(rows, cols, gap, offset);
        for t in 0..rows {
            filled.mat().row_mut(t).fill(value);
        }
        filled
    }

    /// One row of `len` elements.
    pub fn slice(len: usize, offset: usize) -> Self {
        Self::new(1, len, 0, offset)
    }

    /// The same filled with the values of `from`, for operations in place.
    pub fn copy_of(from: Mat<T>, gap: usize, offset: usize) -> Self {
        let mut copy = Self::new(from.rows(), from.cols(), gap, offset);
        for t in 0..from.rows() {
            copy.mat().row_mut(t).copy_from_slice(from.row(t));
        }
        copy
    }

    /// The matrix, writable.
    pub fn mat(&mut self) -> MatMut<'_, T> {
        let data = &mut self.data[GUARD + self.offset..];
        MatMut::with_stride(data, self.rows, self.cols, self.stride).expect("sized by new")
    }

    /// Row 0, writable.
    pub fn first_row(&mut self) -> &mut [T] {
        &mut self.data[GUARD + self.offset..][..self.cols]
    }

    /// Row `t` of the result.
    pub fn row(&self, t: usize) -> &[T] {
        &self.data[GUARD + self.offset + t * self.stride..][..self.cols]
    }

    /// All rows of the result, after a check that every canary lives.
    pub fn checked(&self) -> Vec<Vec<T>> {
        let start = GUARD + self.offset;
        for (i, value) in self.data.iter().enumerate() {
            let inside =
                i >= start && i < start + self.rows * self.stride && (i - start) % self.stride.max(1) < self.cols;
            assert!(
                inside || *value == T::CANARY,
                "a write outside the output, at element {} of it",
                i.wrapping_sub(start)
            );
        }
        (0..self.rows).map(|t| self.row(t).to_vec()).collect()
    }
}

/// The bits of every value: `-0.0` and `0.0` differ, NaN equals itself.
pub fn bits(rows: &[Vec<f32>]) -> Vec<Vec<u32>> {
    rows.iter().map(|row| row.iter().map(|value| value.to_bits()).collect()).collect()
}

/// One unit in the last place of 1 in f32: twice the largest relative error of one operation.
pub const EPSILON: f64 = f32::EPSILON as f64;

/// Powers of e below this are 0 in the kernels.
pub const SMALLEST_POWER: f64 = 1.2e-38;

/// One unit in the last place of an f32 result of this exact value.
pub fn ulp(exact: f64) -> f64 {
    let size = exact.abs().max(f64::from(f32::MIN_POSITIVE));
    2.0_f64.powf(size.log2().floor() - 23.0)
}

/// How many cases a property tries: `PROPTEST_CASES`, or `cases`. Failures print their seed and are
/// not written to files.
pub fn cases(cases: u32) -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|given| given.parse().ok()).unwrap_or(cases);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// The README's example, compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

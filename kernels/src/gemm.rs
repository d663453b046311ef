//! Shared parts of the matrix products of all element types: rows of inputs, epilogues, panels of
//! weights, and the micro-kernels that differ between element types only in the load of a
//! weight.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512vnni;
#[cfg(target_arch = "aarch64")]
pub(crate) mod neon;
pub(crate) mod scalar;
#[cfg(target_arch = "wasm32")]
pub(crate) mod simd128;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "wasm32"))]
mod task;

use crate::error::{ShapeError, expect_len};
use crate::mat::{Mat, MatMut};
use crate::math::Activation;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "wasm32"))]
pub(crate) use task::{GemmTask, Panels, Scaled, tiles};

/// The rows that a product reads: all rows of a matrix in order, or the rows of an index.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a, T> {
    pub(crate) mat: Mat<'a, T>,
    pub(crate) index: Option<&'a [u32]>,
}

impl<'a, T> Input<'a, T> {
    /// Every row of `mat`.
    #[inline]
    pub fn all(mat: Mat<'a, T>) -> Self {
        Self { mat, index: None }
    }

    /// Row `index[i]` of `mat` as input row `i`, without a copy.
    ///
    /// # Errors
    /// [`ShapeError`] if an index is beyond the rows of `mat`.
    pub fn gather(mat: Mat<'a, T>, index: &'a [u32]) -> Result<Self, ShapeError> {
        match index.iter().find(|&&i| i as usize >= mat.rows()) {
            Some(&i) => Err(ShapeError { arg: "index", want: mat.rows(), got: i as usize }),
            None => Ok(Self { mat, index: Some(index) }),
        }
    }

    /// Number of input rows.
    #[inline]
    pub fn rows(&self) -> usize {
        self.index.map_or(self.mat.rows(), <[u32]>::len)
    }

    /// Inputs per row.
    #[inline]
    pub fn cols(&self) -> usize {
        self.mat.cols()
    }

    /// Input row `i`.
    #[inline]
    pub fn row(&self, i: usize) -> &'a [T] {
        self.mat.row(self.index.map_or(i, |index| index[i] as usize))
    }
}

/// Destination of a product's rows: output row `i` is added to row `rows[i]` of `y`, times
/// `weight[i]`.
#[derive(Clone, Copy, Debug)]
pub struct Scatter<'a> {
    /// Row of `y` for each output row.
    pub rows: &'a [u32],
    /// Factor for each output row.
    pub weight: &'a [f32],
}

/// Epilogue of a product: `v = activation(sum + bias)`, then stored, added, or scattered.
#[derive(Clone, Copy, Debug, Default)]
pub struct Epilogue<'a> {
    /// `[n]`, added to every row's sums.
    pub bias: Option<&'a [f32]>,
    /// Applied after the bias.
    pub activation: Activation,
    /// `y += v` instead of `y = v`.
    pub add: bool,
    /// Output rows are weighted and added to other rows (implies `add`).
    pub scatter: Option<Scatter<'a>>,
}

impl<'a> Epilogue<'a> {
    /// Stores the sums as they are.
    pub const STORE: Epilogue<'static> =
        Epilogue { bias: None, activation: Activation::None, add: false, scatter: None };
    /// Adds the sums to `y`: a residual connection.
    pub const ADD: Epilogue<'static> = Epilogue { add: true, ..Epilogue::STORE };

    /// Stores `sum + bias`.
    pub const fn bias(bias: &'a [f32]) -> Self {
        Self { bias: Some(bias), ..Epilogue::STORE }
    }

    /// Adds an activation.
    #[must_use]
    pub const fn then(self, activation: Activation) -> Self {
        Self { activation, ..self }
    }

    /// Adds to `y` instead of overwriting it.
    #[must_use]
    pub const fn added(self) -> Self {
        Self { add: true, ..self }
    }

    /// This epilogue restricted to the outputs `range`.
    #[must_use]
    pub fn outputs(self, range: core::ops::Range<usize>) -> Self {
        Self { bias: self.bias.map(|bias| &bias[range]), ..self }
    }
}

/// Checks one product: `x [m, k]`, `w [n, k]`, `y [m, n]` (or scattered), `bias [n]`.
pub(crate) fn check_product(
    x: (usize, usize),
    w: (usize, usize),
    y: &MatMut<f32>,
    epilogue: &Epilogue,
) -> Result<(), ShapeError> {
    let ((m, k), (n, w_k)) = (x, w);
    expect_len("w", k, w_k)?;
    expect_len("y", n, y.cols())?;
    if let Some(bias) = epilogue.bias {
        expect_len("bias", n, bias.len())?;
    }
    let Some(scatter) = epilogue.scatter else { return expect_len("y", m, y.rows()) };
    expect_len("scatter.rows", m, scatter.rows.len())?;
    expect_len("scatter.weight", m, scatter.weight.len())?;
    match scatter.rows.iter().find(|&&row| row as usize >= y.rows()) {
        Some(&row) => Err(ShapeError { arg: "scatter.rows", want: y.rows(), got: row as usize }),
        None => Ok(()),
    }
}

/// The same address, opaque to the compiler: it reloads the value instead of keeping it in
/// a register.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline]
#[expect(clippy::pointers_in_nomem_asm_block, reason = "the address alone is passed, and nothing is read there")]
pub(crate) fn opaque<T>(mut address: *const T) -> *const T {
    // SAFETY: the assembly has no instruction.
    unsafe { core::arch::asm!("/* {0} */", inout(reg) address, options(nomem, nostack, preserves_flags)) };
    address
}

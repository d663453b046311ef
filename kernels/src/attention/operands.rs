//! The operands of one call, and their checks.

use crate::bf16::Bf16;
use crate::error::{ShapeError, expect_len};
use crate::mat::{Mat, MatMut};
use crate::prefetch::PrefetchHint;

/// A bias that depends only on `key - query`: query `i` adds `values[origin + j - i]` to its score
/// of key `j`.
///
/// All biases of one query are contiguous, so that no `[m, n]` matrix of them exists.
#[derive(Clone, Copy, Debug)]
pub struct RelativeBias<'a> {
    /// One value per distance, ascending.
    pub values: &'a [f32],
    /// Index of query 0's bias for key 0.
    pub origin: usize,
}

/// Keys that a query sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visible {
    /// Every query sees every key.
    All,
    /// Query `i` sees the keys `0..=first + i`.
    Causal {
        /// The last key that query 0 sees.
        first: usize,
    },
}

/// A stored number as f32.
pub(super) trait Widen: Copy {
    fn widen(self) -> f32;
}

impl Widen for f32 {
    fn widen(self) -> f32 {
        self
    }
}

impl Widen for Bf16 {
    fn widen(self) -> f32 {
        self.to_f32()
    }
}

/// The operands of the attention of one head: queries, keys, values, bias and mask.
///
/// All are strided, so that a head is a column range of the projections.
#[derive(Clone, Copy, Debug)]
pub struct Operands<'a, T> {
    /// `[m, head_dim]`.
    pub(super) q: Mat<'a, f32>,
    /// `[n, head_dim]`.
    pub(super) k: Mat<'a, T>,
    /// `[n, head_dim]`.
    pub(super) v: Mat<'a, T>,
    /// Factor of the scores, before the bias is added.
    pub(super) scale: f32,
    pub(super) bias: Option<RelativeBias<'a>>,
    pub(super) visible: Visible,
    #[cfg_attr(
        not(any(target_arch = "x86_64", target_arch = "aarch64")),
        expect(dead_code, reason = "nothing is fetched")
    )]
    pub(super) hint: PrefetchHint<'a>,
    /// Prefetch the keys and values of this call, and ignore the hint.
    #[cfg_attr(
        not(any(target_arch = "x86_64", target_arch = "aarch64")),
        expect(dead_code, reason = "nothing is fetched")
    )]
    pub(super) self_prefetch: bool,
}

impl<'a, T> Operands<'a, T> {
    /// Queries `[m, head_dim]`, keys and values `[n, head_dim]`, and the factor of their scores.
    /// Every query sees every key, without a bias.
    pub fn new(q: Mat<'a, f32>, k: Mat<'a, T>, v: Mat<'a, T>, scale: f32) -> Self {
        let (bias, visible, hint) = (None, Visible::All, PrefetchHint::NONE);
        Self { q, k, v, scale, bias, visible, hint, self_prefetch: false }
    }

    /// Adds a bias.
    #[must_use]
    pub fn biased(self, bias: impl Into<Option<RelativeBias<'a>>>) -> Self {
        Self { bias: bias.into(), ..self }
    }

    /// Limits the keys that queries see to `visible`. Encoder attention ignores it.
    #[must_use]
    pub fn seeing(self, visible: Visible) -> Self {
        Self { visible, ..self }
    }

    /// Sets the operands of the next operation, which calls with few queries prefetch.
    #[must_use]
    pub fn hinting(self, hint: PrefetchHint<'a>) -> Self {
        Self { hint, ..self }
    }

    /// Checks the shapes; returns whether there is anything to compute.
    pub(super) fn check(&self, y: &MatMut<f32>) -> Result<bool, ShapeError> {
        let Self { q, k, v, .. } = self;
        expect_len("k", q.cols(), k.cols())?;
        expect_len("v", k.rows(), v.rows())?;
        expect_len("v", q.cols(), v.cols())?;
        expect_len("y", q.rows(), y.rows())?;
        expect_len("y", q.cols(), y.cols())?;
        if q.rows() == 0 {
            return Ok(false);
        }
        if k.rows() == 0 {
            return Err(ShapeError { arg: "k", want: 1, got: 0 });
        }
        if let Visible::Causal { first } = self.visible {
            let want = first.saturating_add(q.rows());
            if k.rows() < want {
                return Err(ShapeError { arg: "k", want, got: k.rows() });
            }
        }
        if let Some(bias) = self.bias {
            let want = bias.origin.saturating_add(k.rows());
            if bias.origin + 1 < q.rows() {
                return Err(ShapeError { arg: "bias.origin", want: q.rows() - 1, got: bias.origin });
            }
            if bias.values.len() < want {
                return Err(ShapeError { arg: "bias.values", want, got: bias.values.len() });
            }
        }
        Ok(true)
    }

    /// Number of keys, from the first on, that query `i` sees.
    pub(super) fn keys(&self, i: usize) -> usize {
        match self.visible {
            Visible::All => self.k.rows(),
            Visible::Causal { first } => first + i + 1,
        }
    }

    /// Query `i`'s biases from key `first` on, for at least all keys; empty if there is no
    /// bias.
    pub(super) fn bias(&self, i: usize, first: usize) -> &'a [f32] {
        self.bias.map_or(&[], |bias| &bias.values[bias.origin - i + first..])
    }
}

/// The keys and values of every head of some rows, each head with separate places: `[rows, heads,
/// places, head_dim]`, of which the first `filled` places are read.
#[derive(Clone, Copy, Debug)]
pub struct HeadCache<'a> {
    /// Keys.
    pub keys: &'a [f32],
    /// Values.
    pub values: &'a [f32],
    /// Heads per row.
    pub heads: usize,
    /// Places per head.
    pub places: usize,
    /// Places that hold a key and a value.
    pub filled: usize,
}

/// The checked inputs of one call for all heads, each with one query.
#[derive(Clone, Copy)]
pub(super) struct HeadOperands<'a> {
    /// `[rows, heads * head_dim]`.
    pub(super) q: Mat<'a, f32>,
    pub(super) cache: HeadCache<'a>,
    pub(super) scale: f32,
}

impl<'a> HeadOperands<'a> {
    /// Checks the shapes; returns whether there is anything to compute.
    pub(super) fn check(&self, y: &MatMut<f32>) -> Result<bool, ShapeError> {
        let Self { q, cache, .. } = self;
        expect_len("y", q.rows(), y.rows())?;
        expect_len("y", q.cols(), y.cols())?;
        if q.rows() == 0 || q.cols() == 0 {
            return Ok(false);
        }
        if cache.heads == 0 || !q.cols().is_multiple_of(cache.heads) {
            return Err(ShapeError { arg: "cache.heads", want: q.cols(), got: cache.heads });
        }
        if cache.filled == 0 || cache.filled > cache.places {
            return Err(ShapeError { arg: "cache.filled", want: cache.places, got: cache.filled });
        }
        let want = q.rows().saturating_mul(q.cols()).saturating_mul(cache.places);
        for (arg, got) in [("cache.keys", cache.keys.len()), ("cache.values", cache.values.len())] {
            if got < want {
                return Err(ShapeError { arg, want, got });
            }
        }
        Ok(true)
    }

    pub(super) fn head_dim(&self) -> usize {
        self.q.cols() / self.cache.heads
    }

    /// The keys and the values of a head of a row, `[filled, head_dim]`, dense.
    pub(super) fn of_head(&self, row: usize, head: usize) -> [&'a [f32]; 2] {
        let (dim, HeadCache { keys, values, heads, places, filled }) = (self.head_dim(), self.cache);
        let first = (row * heads + head) * places * dim;
        [&keys[first..first + filled * dim], &values[first..first + filled * dim]]
    }

    /// A head of a row as the operands of a separate call.
    pub(super) fn alone(&self, row: usize, head: usize) -> Operands<'a, f32> {
        let (dim, filled) = (self.head_dim(), self.cache.filled);
        let [k, v] = self.of_head(row, head).map(|part| Mat::new(part, filled, dim).expect("as many as there are"));
        Operands::new(self.q.row_range(row..row + 1).columns(head * dim..(head + 1) * dim), k, v, self.scale)
    }

    /// Calls `f` for every head of every row separately.
    pub(super) fn each(&self, y: &mut MatMut<f32>, mut f: impl FnMut(Operands<'a, f32>, MatMut<f32>)) {
        let dim = self.head_dim();
        for row in 0..self.q.rows() {
            for (head, y) in y.row_mut(row).chunks_exact_mut(dim).enumerate() {
                f(self.alone(row, head), MatMut::new(y, 1, dim).expect("a head has `dim` columns"));
            }
        }
    }
}

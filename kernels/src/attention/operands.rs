//! The checked operands of one call, as the back-ends receive them.

use crate::bf16::Bf16;
use crate::error::{ShapeError, expect_len};
use crate::mat::{Mat, MatMut};
use crate::prefetch::PrefetchHint;

/// A bias that depends on `key - query` alone: query `i` adds `values[origin + j - i]` to its score
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

/// Which keys a query sees.
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

/// The checked inputs of one call.
#[derive(Clone, Copy)]
pub(super) struct Operands<'a, T> {
    pub(super) q: Mat<'a, f32>,
    pub(super) k: Mat<'a, T>,
    pub(super) v: Mat<'a, T>,
    pub(super) scale: f32,
    pub(super) bias: Option<RelativeBias<'a>>,
    pub(super) visible: Visible,
    #[cfg_attr(
        not(any(target_arch = "x86_64", target_arch = "aarch64")),
        expect(dead_code, reason = "nothing is fetched")
    )]
    pub(super) hint: PrefetchHint<'a>,
    /// Prefetch the keys and values themselves, and ignore the hint.
    #[cfg_attr(
        not(any(target_arch = "x86_64", target_arch = "aarch64")),
        expect(dead_code, reason = "nothing is fetched")
    )]
    pub(super) self_prefetch: bool,
}

impl<'a, T> Operands<'a, T> {
    /// Whether the shapes agree, and whether there is anything to do.
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

    /// How many keys, from the first on, query `i` sees.
    pub(super) fn keys(&self, i: usize) -> usize {
        match self.visible {
            Visible::All => self.k.rows(),
            Visible::Causal { first } => first + i + 1,
        }
    }

    /// Query `i`'s biases from key `first` on, at least for all keys; empty if there is no
    /// bias.
    pub(super) fn bias(&self, i: usize, first: usize) -> &'a [f32] {
        self.bias.map_or(&[], |bias| &bias.values[bias.origin - i + first..])
    }
}

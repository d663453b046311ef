//! Common parts of T5's attentions: projections and the relative position bias (SPEC 2.4).

use std::ops::Range;
use umo_core_base::functions::Functions;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_kernels::attention::RelativeBias;
use umo_kernels::{MatMut, ShapeError};

use crate::config::Lm;
use crate::linear::{Compute, Linear};
use crate::weights::Loader;

/// Projections of one attention: a single product for all projections that share an input, and the output
/// product.
#[derive(Debug)]
pub(super) struct Projections {
    /// Self-attention: `[3 * inner, d]` for q, k, v; cross-attention: `[inner, d]` for q.
    pub(super) input: Linear,
    /// `[d, inner]`.
    pub(super) output: Linear,
}

impl Projections {
    /// Loads the tensors `{name}.{which}.weight` into one input product, and `{name}.o.weight`.
    pub(super) fn load(loader: &Loader, name: &str, lm: &Lm, which: &[&str]) -> Result<Self, LoadError> {
        let inner = lm.num_heads * lm.d_kv;
        Ok(Self {
            input: projection(loader, name, lm, which)?,
            output: loader.linear(&[format!("{name}.o.weight")], &[lm.d_model], inner)?,
        })
    }
}

/// The tensors `{name}.{which}.weight` as one product.
pub(super) fn projection(loader: &Loader, name: &str, lm: &Lm, which: &[&str]) -> Result<Linear, LoadError> {
    let inner = lm.num_heads * lm.d_kv;
    let names: Vec<String> = which.iter().map(|w| format!("{name}.{w}.weight")).collect();
    loader.linear(&names, &filled(inner, which.len()), lm.d_model)
}

/// Relative position bias of every head, laid out by distance so that the biases of one query are contiguous.
#[derive(Debug)]
pub(super) struct PositionBias {
    /// `[heads, 2 * positions - 1]`, by ascending `key - query`.
    values: Box<[f32]>,
    positions: usize,
}

impl PositionBias {
    /// Reads a table `[buckets, heads]` and lays it out for sequences of at most `positions`.
    pub(super) fn load(
        loader: &Loader,
        name: &str,
        lm: &Lm,
        two_sided: bool,
        positions: usize,
    ) -> Result<Self, LoadError> {
        let (buckets, heads) = (lm.relative_attention_num_buckets, lm.num_heads);
        let table = loader.values(name, &[buckets, heads])?;
        let width = 2 * positions - 1;
        let mut values = filled(0.0, heads * width).into_boxed_slice();
        for (head, values) in values.chunks_exact_mut(width).enumerate() {
            for (i, value) in values.iter_mut().enumerate() {
                let distance = i.cast_signed() - (positions - 1).cast_signed();
                let bucket = bucket(distance, two_sided, buckets, lm.relative_attention_max_distance);
                *value = table[bucket * heads + head];
            }
        }
        Ok(Self { values, positions })
    }

    /// Maximum number of positions in a sequence.
    pub(super) fn positions(&self) -> usize {
        self.positions
    }

    /// The bias of `head` for queries from position `first` on.
    pub(super) fn of(&self, head: usize, first: usize) -> RelativeBias<'_> {
        let width = 2 * self.positions - 1;
        RelativeBias { values: &self.values[head * width..(head + 1) * width], origin: self.positions - 1 - first }
    }
}

/// Bucket of `distance = key - query`. Half of the buckets hold one small distance each; the others grow with
/// its logarithm up to `max_distance`. Computed in f32, like the reference implementation.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded by `buckets`")]
#[expect(clippy::cast_precision_loss, reason = "distances are far below 2^24")]
fn bucket(distance: isize, two_sided: bool, buckets: usize, max_distance: usize) -> usize {
    let side = if two_sided { buckets / 2 } else { buckets };
    let first = if two_sided && distance > 0 { side } else { 0 };
    let size = if two_sided { distance.unsigned_abs() } else { (-distance).max(0).cast_unsigned() };
    let exact = side / 2;
    if size < exact {
        return first + size;
    }
    let octaves = (max_distance as f64 / exact as f64).logarithm() as f32;
    let grown = (size as f32 / exact as f32).logarithm() / octaves * (side - exact) as f32;
    first + (exact + grown as usize).min(side - 1)
}

/// Calls `f(sequence, heads, rows, y)` for every sequence and head; threads share the heads. The call is for
/// the first of `heads`; the same thread processes the others next. Sequence `i` has `counts[i]` rows, below
/// the earlier sequences' rows. `y` is the block of `context` that receives its outputs for that head.
pub(super) fn for_each_head(
    cx: Compute,
    d_kv: usize,
    counts: impl Iterator<Item = usize> + Clone + Sync,
    work: usize,
    context: MatMut<f32>,
    f: impl Fn(usize, Range<usize>, Range<usize>, MatMut<f32>) -> Result<(), ShapeError> + Sync,
) -> Result<(), StepError> {
    cx.team.columns(context, d_kv, work, |columns, y| {
        heads_of(columns, d_kv, counts.clone(), y, |sequence, heads, _, rows, y| f(sequence, heads, rows, y))
    })
}

/// Calls `f(sequence, heads, column, rows, y)` for every sequence and every head in `columns`, where `column`
/// is the head's first column relative to `columns`. `y` is the block of `context` that receives its outputs
/// for that head; `context` holds only these columns.
pub(super) fn heads_of(
    columns: Range<usize>,
    d_kv: usize,
    counts: impl Iterator<Item = usize>,
    context: MatMut<f32>,
    mut f: impl FnMut(usize, Range<usize>, usize, Range<usize>, MatMut<f32>) -> Result<(), ShapeError>,
) -> Result<(), StepError> {
    let (mut rest, mut first) = (context, 0);
    for (sequence, count) in counts.enumerate().filter(|&(_, count)| count > 0) {
        let (mut y, below) = rest.split_rows(count);
        for at in (0..columns.len()).step_by(d_kv) {
            let (head, tail) = y.split_columns(d_kv);
            f(sequence, (columns.start + at) / d_kv..columns.end / d_kv, at, first..first + count, head)?;
            y = tail;
        }
        (rest, first) = (below, first + count);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::bucket;

    /// Values of the reference implementation for 32 buckets and a distance of 128.
    #[test]
    fn buckets_are_those_of_t5() {
        let two_sided = [-200, -128, -64, -16, -9, -8, -7, -1, 0, 1, 7, 8, 12, 32, 127, 128];
        let two_sided = two_sided.map(|distance| bucket(distance, true, 32, 128));
        assert_eq!(two_sided, [15, 15, 14, 10, 8, 8, 7, 1, 0, 17, 23, 24, 25, 28, 31, 31]);
        let one_sided = [5, 0, -1, -15, -16, -20, -64, -127, -1000].map(|distance| bucket(distance, false, 32, 128));
        assert_eq!(one_sided, [0, 0, 1, 15, 16, 17, 26, 31, 31]);
    }
}

//! A pre-norm transformer layer, equivalent to PyTorch's
//! `nn.TransformerEncoderLayer(norm_first=True, activation="gelu")`.

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_kernels::activation::Activation;
use umo_kernels::attention::{Operands, encoder_attention_f32};
use umo_kernels::gemm::Epilogue;
use umo_kernels::norm::layer_norm;
use umo_kernels::{Isa, Mat, MatMut};

use crate::config;
use crate::linear::{Compute, Linear, QuantScratch};
use crate::weights::Loader;

/// Epsilon added to variances: PyTorch's default.
pub(super) const EPS: f32 = 1e-5;

/// A layer norm's tensors.
#[derive(Debug)]
pub(super) struct Norm {
    pub(super) weight: Box<[f32]>,
    pub(super) bias: Box<[f32]>,
}

impl Norm {
    pub(super) fn load(loader: &Loader, name: &str, dim: usize) -> Result<Self, LoadError> {
        let vector = |what: &str| loader.vector(&format!("{name}.{what}"), dim);
        Ok(Self { weight: vector("weight")?, bias: vector("bias")? })
    }
}

/// Attention and feed-forward, each with a norm before it and a residual connection.
#[derive(Debug)]
pub(super) struct Layer {
    norm1: Norm,
    /// Queries, keys and values side by side, `[3 dim, dim]`.
    projection: Linear,
    output: Linear,
    norm2: Norm,
    expand: Linear,
    contract: Linear,
    heads: usize,
}

/// Scratch memory for a layer over a fixed number of rows.
#[derive(Debug)]
pub(super) struct LayerScratch {
    /// `[rows, dim]`
    normed: Box<[f32]>,
    /// `[rows, 3 dim]`
    qkv: Box<[f32]>,
    /// `[rows, dim]`
    attended: Box<[f32]>,
    /// `[rows, ffn_dim]`
    ffn: Box<[f32]>,
    quant: QuantScratch,
}

impl LayerScratch {
    pub(crate) fn new(rows: usize, dim: usize, ffn_dim: usize) -> Self {
        let room = |cols: usize| filled(0.0, rows * cols).into_boxed_slice();
        Self {
            normed: room(dim),
            qkv: room(3 * dim),
            attended: room(dim),
            ffn: room(ffn_dim),
            quant: QuantScratch::new(rows, dim.max(ffn_dim)),
        }
    }

    pub(super) fn quant(&mut self) -> &mut QuantScratch {
        &mut self.quant
    }
}

impl Layer {
    pub(super) fn load(loader: &Loader, name: &str, sizes: &config::Interp) -> Result<Self, LoadError> {
        let (dim, ffn_dim) = (sizes.d_model, sizes.d_ff);
        let attention = format!("{name}.self_attn");
        let projection = loader.linear(&[format!("{attention}.in_proj_weight")], &[3 * dim], dim)?;
        Ok(Self {
            norm1: Norm::load(loader, &format!("{name}.norm1"), dim)?,
            projection: projection.with_bias(loader.vector(&format!("{attention}.in_proj_bias"), 3 * dim)?),
            output: loader.linear_with_bias(&format!("{attention}.out_proj"), dim, dim)?,
            norm2: Norm::load(loader, &format!("{name}.norm2"), dim)?,
            expand: loader.linear_with_bias(&format!("{name}.linear1"), ffn_dim, dim)?,
            contract: loader.linear_with_bias(&format!("{name}.linear2"), dim, ffn_dim)?,
            heads: sizes.num_heads,
        })
    }

    pub(super) fn ffn_dim(&self) -> usize {
        self.expand.outputs()
    }

    /// Runs over `x [rows, dim]` in place. A row attends only to the rows of its group of `group` rows.
    pub(super) fn run(&self, cx: Compute, s: &mut LayerScratch, group: usize, x: &mut [f32]) -> Result<(), StepError> {
        self.project(cx, s, x)?;
        let dim = self.projection.inputs();
        let rows = x.len() / dim;
        self.attend(cx, Mat::new(&s.qkv, rows, 3 * dim)?, group, &mut s.attended)?;
        self.finish(cx, s, x)
    }

    /// Runs over the rows of `x [rows, dim]` from `first` on, which attend to all rows; earlier rows do not
    /// change. Gives the same bits as [`Self::run`] with one group.
    pub(super) fn run_from(
        &self,
        cx: Compute,
        s: &mut LayerScratch,
        first: usize,
        x: &mut [f32],
    ) -> Result<(), StepError> {
        self.project(cx, s, x)?;
        let dim = self.projection.inputs();
        let rows = x.len() / dim;
        let work = 2 * (rows - first) * rows * dim;
        let (qkv, y) = (Mat::new(&s.qkv, rows, 3 * dim)?, MatMut::new(&mut s.attended, rows - first, dim)?);
        let heads = |columns, y| self.heads_of(cx.isa, qkv, first, columns, y);
        cx.team.columns(y, dim / self.heads, work, heads)?;
        self.finish(cx, s, &mut x[first * dim..])
    }

    /// Computes queries, keys and values of all rows of `x`.
    fn project(&self, cx: Compute, s: &mut LayerScratch, x: &[f32]) -> Result<(), StepError> {
        let dim = self.projection.inputs();
        let rows = x.len() / dim;
        normed(cx, x, &self.norm1, &mut s.normed)?;
        let y = MatMut::new(&mut s.qkv, rows, 3 * dim)?;
        self.projection.forward(cx, &mut s.quant, Mat::new(&s.normed, rows, dim)?, Epilogue::STORE, y)
    }

    /// Adds the output projection of the attention, then the feed-forward network's output.
    fn finish(&self, cx: Compute, s: &mut LayerScratch, x: &mut [f32]) -> Result<(), StepError> {
        let (dim, ffn_dim) = (self.projection.inputs(), self.ffn_dim());
        let rows = x.len() / dim;
        let attended = Mat::new(&s.attended, rows, dim)?;
        self.output.forward(cx, &mut s.quant, attended, Epilogue::ADD, MatMut::new(x, rows, dim)?)?;
        normed(cx, x, &self.norm2, &mut s.normed)?;
        let y = MatMut::new(&mut s.ffn, rows, ffn_dim)?;
        let gelu = Epilogue::STORE.then(Activation::Gelu);
        self.expand.forward(cx, &mut s.quant, Mat::new(&s.normed, rows, dim)?, gelu, y)?;
        let ffn = Mat::new(&s.ffn, rows, ffn_dim)?;
        self.contract.forward(cx, &mut s.quant, ffn, Epilogue::ADD, MatMut::new(x, rows, dim)?)
    }

    /// Attention of every head within each group of rows. Threads share the heads of a single group, or the
    /// groups if there are several.
    fn attend(&self, cx: Compute, qkv: Mat<f32>, group: usize, y: &mut [f32]) -> Result<(), StepError> {
        let (rows, dim) = (qkv.rows(), qkv.cols() / 3);
        let work = 2 * rows * group * dim;
        let head_dim = dim / self.heads;
        if group == rows {
            let y = MatMut::new(y, rows, dim)?;
            return cx.team.columns(y, head_dim, work, |columns, y| self.heads_of(cx.isa, qkv, 0, columns, y));
        }
        let groups = MatMut::new(y, rows / group, group * dim)?;
        cx.team.rows(groups, work, |range, mut groups| {
            for (i, index) in range.enumerate() {
                let qkv = qkv.row_range(index * group..(index + 1) * group);
                self.heads_of(cx.isa, qkv, 0, 0..dim, MatMut::new(groups.row_mut(i), group, dim)?)?;
            }
            Ok(())
        })
    }

    /// Computes the heads in `columns`, for the queries of the rows of `qkv` from `start` on, over all rows.
    fn heads_of(
        &self,
        isa: Isa,
        qkv: Mat<f32>,
        start: usize,
        columns: Range<usize>,
        y: MatMut<f32>,
    ) -> Result<(), StepError> {
        let dim = qkv.cols() / 3;
        let head_dim = dim / self.heads;
        let scale = 1.0 / (head_dim as f32).sqrt();
        let mut rest = y;
        for first in columns.step_by(head_dim) {
            let part = |i: usize| qkv.columns(i * dim + first..i * dim + first + head_dim);
            let (y, right) = rest.split_columns(head_dim);
            rest = right;
            let queries = part(0).row_range(start..qkv.rows());
            encoder_attention_f32(isa, Operands::new(queries, part(1), part(2), scale), y)?;
        }
        Ok(())
    }
}

/// Applies a norm to `x [rows, dim]`.
fn normed(cx: Compute, x: &[f32], norm: &Norm, y: &mut [f32]) -> Result<(), StepError> {
    let dim = norm.weight.len();
    let rows = x.len() / dim;
    layer_norm(cx.isa, Mat::new(x, rows, dim)?, &norm.weight, &norm.bias, EPS, MatMut::new(y, rows, dim)?)?;
    Ok(())
}

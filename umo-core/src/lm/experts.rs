//! The expert feed-forward: router, grouped gated products, weighted sum (paper section 3.2; SPEC 2.4).

use std::ops::Range;

use umo_kernels::experts::{Routing, route};
use umo_kernels::matmul_f32::{Epilogue, Scatter};
use umo_kernels::{Mat, MatMut, PANEL};

use super::norm;
use crate::config::Lm;
use crate::error::{LoadError, StepError};
use crate::linear::{Compute, Linear, QuantScratch, Ready};
use crate::weights::{AlignedBox, Loader};

/// One layer's norm, router and experts.
#[derive(Debug)]
pub(super) struct Experts {
    norm: Box<[f32]>,
    eps: f32,
    router: Linear,
    experts: Box<[Expert]>,
    top_k: usize,
    d_ff: usize,
}

/// `wo(gelu_tanh(wi_0 x) * wi_1 x)`.
#[derive(Debug)]
struct Expert {
    gate: Linear,
    up: Linear,
    down: Linear,
}

/// Routing of at most `rows` rows, and the hidden rows of all chosen experts.
#[derive(Debug)]
pub(crate) struct ExpertScratch {
    /// `[rows, experts]`.
    logits: Box<[f32]>,
    /// `[experts + 1]`.
    starts: Box<[u32]>,
    /// `[rows * top_k]`.
    rows: Box<[u32]>,
    /// `[rows * top_k]`.
    weights: Box<[f32]>,
    /// `[rows * top_k, d_ff]`.
    hidden: AlignedBox<f32>,
}

impl ExpertScratch {
    pub(super) fn new(lm: &Lm, rows: usize) -> Self {
        let slots = rows * lm.top_k;
        Self {
            logits: vec![0.0; rows * lm.experts].into(),
            starts: vec![0; lm.experts + 1].into(),
            rows: vec![0; slots].into(),
            weights: vec![0.0; slots].into(),
            hidden: AlignedBox::zeroed(slots * lm.d_ff),
        }
    }

    /// The rows that the last layer sent to `expert`.
    pub(super) fn rows_of(&self, expert: usize) -> &[u32] {
        &self.rows[self.starts[expert] as usize..self.starts[expert + 1] as usize]
    }
}

impl Experts {
    /// Loads `{name}.layer_norm` and `{name}.moe`.
    pub(super) fn load(loader: &Loader, name: &str, lm: &Lm) -> Result<Self, LoadError> {
        let router = format!("{name}.moe.router.weight");
        let tensor = |e: usize, which: &str| format!("{name}.moe.experts.{e}.{which}.weight");
        let all = |which: &[&str]| -> Vec<String> {
            (0..lm.experts).flat_map(|e| which.iter().map(move |which| tensor(e, which))).collect()
        };
        // All experts share the quantised input, and the products of its two halves are multiplied.
        let (inside, down) = (loader.alike(&all(&["wi_0", "wi_1"]))?, loader.alike(&all(&["wo"]))?);
        let expert = |e: usize| {
            Ok(Expert {
                gate: inside.linear(&[tensor(e, "wi_0")], &[lm.d_ff], lm.d_model)?,
                up: inside.linear(&[tensor(e, "wi_1")], &[lm.d_ff], lm.d_model)?,
                down: down.linear(&[tensor(e, "wo")], &[lm.d_model], lm.d_ff)?,
            })
        };
        Ok(Self {
            norm: loader.vector(&format!("{name}.layer_norm.weight"), lm.d_model)?,
            eps: lm.layer_norm_epsilon,
            router: loader.exact().linear(&[router], &[lm.experts], lm.d_model)?,
            experts: (0..lm.experts).map(expert).collect::<Result<_, LoadError>>()?,
            top_k: lm.top_k,
            d_ff: lm.d_ff,
        })
    }

    /// `hidden += moe(norm(hidden))`; `hidden`, `normed` `[rows, d_model]`.
    pub(super) fn forward(
        &self,
        cx: Compute,
        quant: &mut QuantScratch,
        scratch: &mut ExpertScratch,
        hidden: &mut [f32],
        normed: &mut [f32],
    ) -> Result<(), StepError> {
        let d = self.norm.len();
        let rows = hidden.len() / d;
        norm(cx, hidden, rows, (&self.norm, self.eps), normed)?;
        let x = Mat::new(normed, rows, d)?;
        self.route(cx, scratch, x)?;
        let ExpertScratch { starts, rows: slot_rows, weights, hidden: gated, .. } = scratch;

        let input = self.experts[0].gate.input(cx, quant, x)?;
        self.each(starts, |expert, slots| {
            let y = MatMut::new(&mut gated[slots.start * self.d_ff..], slots.len(), self.d_ff)?;
            expert.gate.apply_gated(&expert.up, cx, input, Some(&slot_rows[slots]), y)
        })?;

        let gated = Mat::new(gated, rows * self.top_k, self.d_ff)?;
        let input = self.experts[0].down.input(cx, quant, gated)?;
        self.each(starts, |expert, slots| {
            let scatter = Scatter { rows: &slot_rows[slots.clone()], weight: &weights[slots.clone()] };
            let end = Epilogue { scatter: Some(scatter), ..Epilogue::STORE };
            expert.down.apply(cx, input.row_range(slots), None, 0..d, end, MatMut::new(hidden, rows, d)?)
        })
    }

    /// Which of the rows of `x` go to which expert. The router has too few outputs to be shared by columns, so threads
    /// share its rows.
    fn route(&self, cx: Compute, scratch: &mut ExpertScratch, x: Mat<f32>) -> Result<(), StepError> {
        let (rows, experts) = (x.rows(), self.experts.len());
        let logits = &mut scratch.logits[..rows * experts];
        cx.team.rows(MatMut::new(logits, rows, experts)?, rows * x.cols() * PANEL, |range, y| {
            self.router.apply(cx, Ready::Float(x.row_range(range)), None, 0..experts, Epilogue::STORE, y)
        })?;
        let slots = rows * self.top_k;
        let mut routing = Routing {
            starts: &mut scratch.starts,
            rows: &mut scratch.rows[..slots],
            weights: &mut scratch.weights[..slots],
        };
        route(cx.isa, MatMut::new(logits, rows, experts)?, self.top_k, &mut routing)?;
        Ok(())
    }

    /// Calls `f` for every expert that has rows, with its slots.
    fn each(
        &self,
        starts: &[u32],
        mut f: impl FnMut(&Expert, Range<usize>) -> Result<(), StepError>,
    ) -> Result<(), StepError> {
        for (expert, bounds) in self.experts.iter().zip(starts.windows(2)) {
            let slots = bounds[0] as usize..bounds[1] as usize;
            if !slots.is_empty() {
                f(expert, slots)?;
            }
        }
        Ok(())
    }
}

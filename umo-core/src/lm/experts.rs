//! The expert feed-forward: router, grouped gated products, weighted sum (paper section 3.2; SPEC 2.4).

use std::ops::Range;

use umo_kernels::experts::{Routing, route};
use umo_kernels::gemm::{Epilogue, Scatter};
use umo_kernels::{MatMut, PANEL};

use super::norm_input;
use crate::config::Lm;
use crate::error::{LoadError, StepError};
use crate::linear::{Compute, Linear, QuantScratch, Ready};
use crate::memory::filled;
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
            logits: filled(0.0, rows * lm.experts).into(),
            starts: filled(0, lm.experts + 1).into(),
            rows: filled(0, slots).into(),
            weights: filled(0.0, slots).into(),
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
        // All experts share the quantized input, and the products of its two halves are multiplied.
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

    /// `hidden += moe(norm(hidden))`; `hidden`, `normed` `[rows, d_model]`. Threads share rows of
    /// the norm and the router, then columns of all experts at once. `then` says what comes behind
    /// the last product.
    pub(super) fn forward(
        &self,
        cx: Compute,
        (quant, middle): (&mut QuantScratch, &mut QuantScratch),
        scratch: &mut ExpertScratch,
        hidden: &mut [f32],
        normed: &mut [f32],
        then: impl Fn(),
    ) -> Result<(), StepError> {
        let (d, experts) = (self.norm.len(), self.experts.len());
        let rows = hidden.len() / d;
        let slots = rows * self.top_k;
        let first = &self.experts[0];
        let ExpertScratch { starts, rows: slot_rows, weights, hidden: gated, logits } = scratch;

        let scores = MatMut::new(logits, rows, experts)?;
        let next = (&first.gate, quant);
        let input = norm_input(cx, hidden, (&self.norm, self.eps), normed, next, scores, d * PANEL, |x, scores| {
            self.router.apply_here(cx, Ready::Float(x), None, 0..experts, Epilogue::STORE, scores)
        })?;
        let mut routing = Routing { starts, rows: &mut slot_rows[..slots], weights: &mut weights[..slots] };
        route(cx.isa, MatMut::new(logits, rows, experts)?, self.top_k, &mut routing)?;

        // One expert after the other: what it computes in its middle is still in cache when it is
        // read.
        self.each(starts, |expert, next, slots| {
            let (rows_of, weight) = (&slot_rows[slots.clone()], &weights[slots.clone()]);
            let (gated, work) = ((&mut gated[..], slots.len()), 2 * slots.len() * d * self.d_ff);
            expert.down.expect(cx);
            let input = middle.computed(cx, &expert.down, gated, PANEL, work, (&mut [], 0), |columns, to| {
                expert.gate.apply_gated_here(&expert.up, cx, input, Some(rows_of), columns, to.y.reborrow())?;
                to.complete(0..slots.len())
            })?;
            match next {
                Some(next) => next.expect(cx),
                None => then(),
            }
            let scatter = Scatter { rows: rows_of, weight };
            let end = Epilogue { scatter: Some(scatter), ..Epilogue::STORE };
            expert.down.apply(cx, input, None, 0..d, end, MatMut::new(hidden, rows, d)?)
        })
    }

    /// Tells the thread that will compute them that norm and router come after the next job.
    pub(super) fn expect(&self, cx: Compute) {
        cx.team.expect(1, 1, |_| self.router.ahead(0..self.experts.len()).tuned_for(cx.isa));
    }

    /// Calls `f` for every expert that has rows, with the next one that has, and its slots.
    fn each(
        &self,
        starts: &[u32],
        mut f: impl FnMut(&Expert, Option<&Expert>, Range<usize>) -> Result<(), StepError>,
    ) -> Result<(), StepError> {
        let slots = starts.windows(2).map(|bounds| bounds[0] as usize..bounds[1] as usize);
        let mut used = self.experts.iter().zip(slots).filter(|(_, slots)| !slots.is_empty()).peekable();
        while let Some((expert, slots)) = used.next() {
            f(expert, used.peek().map(|&(next, _)| next), slots)?;
        }
        Ok(())
    }
}

impl Expert {
    /// Tells the threads that its first products come after the next job.
    fn expect(&self, cx: Compute) {
        self.gate.expect_gated(&self.up, cx);
    }
}

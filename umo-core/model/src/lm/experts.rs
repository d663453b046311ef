//! The expert feed-forward: router, grouped gated products, weighted sum (paper section 3.2; SPEC 2.4).

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_kernels::experts::{Routing, route};
use umo_kernels::gemm::{Epilogue, Scatter};
use umo_kernels::product::Rows;
use umo_kernels::{MatMut, PANEL};

use super::{norm_input, piece_rows};
use crate::config::Lm;
use crate::linear::{Compute, Linear, QuantScratch};
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

/// Routing of at most `rows` rows, and the hidden rows of all selected experts.
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
    pub(crate) fn new(lm: &Lm, rows: usize) -> Self {
        let slots = rows * lm.top_k;
        Self {
            logits: filled(0.0, rows * lm.experts).into(),
            starts: filled(0, lm.experts + 1).into(),
            rows: filled(0, slots).into(),
            weights: filled(0.0, slots).into(),
            hidden: AlignedBox::zeroed(slots * lm.d_ff),
        }
    }

    /// Rows that the last layer sent to `expert`.
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
        // All experts share the quantized input, and the outputs of `wi_0` and `wi_1` are multiplied with
        // each other.
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

    /// Computes `hidden += moe(norm(hidden))`; `hidden` and `normed` are `[rows, d_model]`. Threads share the
    /// rows of the norm and the router, then the columns of one expert at a time. `then` issues the prefetch
    /// hints for the operation after the last product.
    pub(super) fn forward(
        &self,
        cx: Compute,
        (quant, middle): (&mut QuantScratch, &mut QuantScratch),
        scratch: &mut ExpertScratch,
        hidden: &mut [f32],
        normed: &mut [f32],
        then: impl Fn(),
    ) -> Result<(), StepError> {
        let d = self.norm.len();
        let input = self.route(cx, quant, scratch, hidden, normed)?;
        let ExpertScratch { starts, rows, weights, hidden: gated, .. } = scratch;
        let count = hidden.len() / d;
        // One expert after the other, so that its hidden rows are still in cache when they are read.
        self.each(starts, |expert, next, slots| {
            let to = Scatter { rows: &rows[slots.clone()], weight: &weights[slots] };
            expert.down.prefetch_next(cx);
            let after = || match next {
                Some(next) => next.prefetch_next(cx),
                None => then(),
            };
            expert.forward(cx, input, middle, to, gated, MatMut::new(hidden, count, d)?, after)
        })
    }

    /// Computes the slots of [`Self::forward`] from `slot` on, up to the size of a piece. Returns the first
    /// slot of the next piece, if any. All pieces must run in order, with no other use of the scratches in
    /// between.
    pub(super) fn piece(
        &self,
        cx: Compute,
        (quant, middle): (&mut QuantScratch, &mut QuantScratch),
        scratch: &mut ExpertScratch,
        hidden: &mut [f32],
        normed: &mut [f32],
        slot: usize,
    ) -> Result<Option<usize>, StepError> {
        let d = self.norm.len();
        let count = hidden.len() / d;
        let input = match slot {
            0 => self.route(cx, quant, scratch, hidden, normed)?,
            _ => quant.again(&self.experts[0].gate, normed, count)?,
        };
        let ExpertScratch { starts, rows, weights, hidden: gated, .. } = scratch;
        let index = starts.partition_point(|&start| start as usize <= slot) - 1;
        let (Some(expert), Some(&[start, end])) = (self.experts.get(index), starts[index..].first_chunk()) else {
            return Ok(None);
        };
        let (start, end) = (start as usize, end as usize);
        let slots = slot..end.min(slot + piece_rows(end - start, 3 * d * self.d_ff));
        let to = Scatter { rows: &rows[slots.clone()], weight: &weights[slots.clone()] };
        expert.forward(cx, input, middle, to, gated, MatMut::new(hidden, count, d)?, || ())?;
        Ok((slots.end < count * self.top_k).then_some(slots.end))
    }

    /// Computes the norm, the router and the slots of each expert. Returns the normed rows, prepared as the
    /// experts' input.
    fn route<'a>(
        &self,
        cx: Compute,
        quant: &'a mut QuantScratch,
        scratch: &mut ExpertScratch,
        hidden: &[f32],
        normed: &'a mut [f32],
    ) -> Result<Rows<'a>, StepError> {
        let (d, experts) = (self.norm.len(), self.experts.len());
        let rows = hidden.len() / d;
        let slots = rows * self.top_k;
        let ExpertScratch { starts, rows: slot_rows, weights, logits, .. } = scratch;
        let (scores, next) = (MatMut::new(logits, rows, experts)?, (&self.experts[0].gate, quant));
        let input = norm_input(cx, hidden, (&self.norm, self.eps), normed, next, scores, d * PANEL, |x, scores| {
            self.router.apply_here(cx.isa, Rows::float(x), 0..experts, Epilogue::STORE, scores)
        })?;
        let mut routing = Routing { starts, rows: &mut slot_rows[..slots], weights: &mut weights[..slots] };
        route(cx.isa, MatMut::new(logits, rows, experts)?, self.top_k, &mut routing)?;
        Ok(input)
    }

    /// Issues a prefetch hint for the router's weights, to the thread that computes norm and router after the
    /// next job.
    pub(super) fn prefetch_next(&self, cx: Compute) {
        cx.team.prefetch_next(1, 1, |_| self.router.prefetch_hint(0..self.experts.len()).tuned_for(cx.isa));
    }

    /// Calls `f` for every expert that has rows, with the next such expert and its own slots.
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
    /// Adds the expert's outputs for the rows of `to` to these rows of `hidden`; `gated` holds its hidden
    /// rows. `then` issues the prefetch hints for the operation after the last product.
    #[expect(clippy::too_many_arguments, reason = "one phase of a layer, each operand named")]
    fn forward(
        &self,
        cx: Compute,
        input: Rows,
        middle: &mut QuantScratch,
        to: Scatter,
        gated: &mut [f32],
        hidden: MatMut<f32>,
        then: impl Fn(),
    ) -> Result<(), StepError> {
        let (rows, d, d_ff) = (to.rows, self.down.outputs(), self.down.inputs());
        let input = input.gather(rows)?;
        let (gated, work) = ((gated, rows.len()), 2 * rows.len() * d * d_ff);
        let inside = middle.computed(cx, &self.down, gated, PANEL, work, (&mut [], 0), |columns, inside| {
            self.gate.apply_gated_here(&self.up, cx.isa, input, columns, inside.y.reborrow())?;
            inside.complete(0..rows.len())
        })?;
        then();
        let epilogue = Epilogue { scatter: Some(to), ..Epilogue::STORE };
        self.down.apply(cx, inside, 0..d, epilogue, hidden)
    }

    /// Issues a prefetch hint for its first products, to the threads that compute them after the next job.
    fn prefetch_next(&self, cx: Compute) {
        self.gate.prefetch_gated_next(&self.up, cx);
    }
}

//! The specification: choose twice, once to count and once to place.

use super::{MAX_EXPERTS, Routing};
use crate::activation::softmax;
use crate::isa::Isa;
use crate::mat::MatMut;

#[expect(clippy::cast_possible_truncation, reason = "row counts are far below 2^32")]
pub(super) fn route(mut logits: MatMut<f32>, top_k: usize, routing: &mut Routing) {
    let (rows, experts) = (logits.rows(), logits.cols());
    routing.starts.fill(0);
    for t in 0..rows {
        let probabilities = logits.row_mut(t);
        softmax(Isa::SCALAR, probabilities);
        for &expert in choose(probabilities, top_k).iter().take(top_k) {
            routing.starts[expert as usize + 1] += 1;
        }
    }
    for e in 0..experts {
        routing.starts[e + 1] += routing.starts[e];
    }
    let mut next = [0_u32; MAX_EXPERTS];
    next[..experts].copy_from_slice(&routing.starts[..experts]);
    for t in 0..rows {
        let probabilities = logits.row(t);
        let chosen = choose(probabilities, top_k);
        let total: f32 = chosen[..top_k].iter().map(|&expert| probabilities[expert as usize]).sum();
        for &expert in &chosen[..top_k] {
            let slot = next[expert as usize] as usize;
            next[expert as usize] += 1;
            routing.rows[slot] = t as u32;
            routing.weights[slot] = probabilities[expert as usize] / total;
        }
    }
}

/// The `top_k` likeliest experts, likeliest first, ties in ascending order.
#[expect(clippy::cast_possible_truncation, reason = "at most MAX_EXPERTS experts")]
fn choose(probabilities: &[f32], top_k: usize) -> [u8; MAX_EXPERTS] {
    let mut chosen = [0; MAX_EXPERTS];
    for place in 0..top_k {
        let mut best: Option<usize> = None;
        for (expert, &p) in probabilities.iter().enumerate() {
            let taken = chosen[..place].contains(&(expert as u8));
            if !taken && best.is_none_or(|b| p > probabilities[b]) {
                best = Some(expert);
            }
        }
        chosen[place] = best.unwrap_or(0) as u8;
    }
    chosen
}

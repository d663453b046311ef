//! Routing: every choice follows from the probabilities, and the sort is stable.

use proptest::prelude::*;
use umo_kernels::experts::{MAX_EXPERTS, Routing, route};
use umo_kernels::tiling::LANES;
use umo_kernels::{Isa, Mat};
use umo_tests::{EPSILON, Fill, Guarded, Noise, Placed, SMALLEST_POWER, cases, for_each_isa, near, offset};

#[derive(Debug, PartialEq)]
struct Routed {
    /// `[rows][experts]`.
    probabilities: Vec<Vec<f32>>,
    starts: Vec<u32>,
    rows: Vec<u32>,
    weights: Vec<f32>,
}

impl Routed {
    fn run(isa: Isa, logits: Mat<f32>, top_k: usize, gap: usize, offset: usize) -> Self {
        let (rows, experts) = (logits.rows(), logits.cols());
        let mut logits = Guarded::copy_of(logits, gap, offset);
        let mut starts = Guarded::slice(experts + 1, offset);
        let mut order = Guarded::slice(rows * top_k, offset);
        let mut weights = Guarded::slice(rows * top_k, offset);
        let mut routing = Routing { starts: starts.first_row(), rows: order.first_row(), weights: weights.first_row() };
        route(isa, logits.mat(), top_k, &mut routing).expect("shapes agree");
        Self {
            probabilities: logits.checked(),
            starts: starts.checked().remove(0),
            rows: order.checked().remove(0),
            weights: weights.checked().remove(0),
        }
    }

    /// Triples (expert, row, weight) in slot order.
    fn slots(&self) -> Vec<(usize, u32, f32)> {
        let of = |e: usize| (self.starts[e] as usize..self.starts[e + 1] as usize).map(move |slot| (e, slot));
        (0..self.starts.len() - 1).flat_map(of).map(|(e, slot)| (e, self.rows[slot], self.weights[slot])).collect()
    }
}

/// Distribution of a layer's logits.
#[derive(Clone, Copy, Debug)]
enum Load {
    Noise(f32),
    /// Few distinct values: most rows have ties.
    Ties,
    AllEqual,
    AllToOne,
    /// Expert 0 is the worst in every row.
    NoneToFirst,
}

fn logits() -> impl Strategy<Value = (Placed<f32>, usize, usize, usize)> {
    let load = prop_oneof![
        Just(Load::Noise(1.0)),
        Just(Load::Noise(100.0)),
        Just(Load::Ties),
        Just(Load::AllEqual),
        Just(Load::AllToOne),
        Just(Load::NoneToFirst)
    ];
    let experts = prop_oneof![4 => 1..=16_usize, 1 => near(LANES, 4).prop_map(|e| e.clamp(1, MAX_EXPERTS))];
    let rows = prop_oneof![near(LANES, 2), near(4, 3)];
    (rows, experts, load, any::<prop::sample::Index>(), 0..20_usize, offset(), any::<u64>()).prop_map(
        |(rows, experts, load, top_k, gap, offset, seed)| {
            let mut noise = Noise::new(seed);
            let favourite = noise.below(experts);
            let mut at = 0;
            let logits = Placed::new(rows, experts, 0, 0, || {
                let expert = at % experts;
                at += 1;
                match load {
                    Load::Noise(size) => noise.float(size),
                    Load::Ties => noise.integer(1),
                    Load::AllEqual => 2.5,
                    Load::AllToOne => noise.float(1.0) + if expert == favourite { 50.0 } else { 0.0 },
                    Load::NoneToFirst => noise.float(1.0) - if expert == 0 { 50.0 } else { 0.0 },
                }
            });
            (logits, top_k.index(experts) + 1, gap, offset)
        },
    )
}

/// Error of a probability: the difference from the maximum is rounded once, `exp` is within 3 units,
/// and the sum has `experts` terms.
fn route_has_the_right_probabilities(isa: Isa) {
    proptest!(cases(96), |((logits, top_k, gap, offset) in logits())| {
        let routed = Routed::run(isa, logits.mat(), top_k, gap, offset);
        for (t, row) in routed.probabilities.iter().enumerate() {
            let logits = logits.mat().row(t);
            let max = f64::from(logits.iter().fold(f32::NEG_INFINITY, |max, &x| max.max(x)));
            let total: f64 = logits.iter().map(|&x| (f64::from(x) - max).exp()).sum();
            for (&got, &x) in row.iter().zip(logits) {
                let below = max - f64::from(x);
                let want = (-below).exp() / total;
                let tolerance = (below + 5.0 + row.len() as f64) * EPSILON * want + SMALLEST_POWER;
                prop_assert!((f64::from(got) - want).abs() <= tolerance, "row {t}: {got}, not {want}");
            }
        }
    });
}

fn route_follows_its_probabilities(isa: Isa) {
    proptest!(cases(96), |((logits, top_k, gap, offset) in logits())| {
        let routed = Routed::run(isa, logits.mat(), top_k, gap, offset);
        let mut want: Vec<(usize, u32, f32)> = vec![];
        for (t, row) in routed.probabilities.iter().enumerate() {
            let mut order: Vec<usize> = (0..row.len()).collect();
            order.sort_by(|&a, &b| row[b].total_cmp(&row[a]).then(a.cmp(&b)));
            let total: f32 = order[..top_k].iter().map(|&e| row[e]).sum();
            want.extend(order[..top_k].iter().map(|&e| (e, u32::try_from(t).expect("few rows"), row[e] / total)));
        }
        want.sort_by_key(|&(expert, row, _)| (expert, row));
        prop_assert_eq!(routed.slots(), want);
        prop_assert!(top_k > 1 || routed.weights.iter().all(|&weight| weight == 1.0));
    });
}

fn route_of_a_row_is_the_same_among_500(isa: Isa) {
    let mut noise = Noise::new(5);
    let logits = Placed::new(500, 6, 0, 0, || Fill::Uniform(2.0).next(&mut noise));
    let together = Routed::run(isa, logits.mat(), 3, 0, 0);
    let slots = together.slots();
    for t in 0..500 {
        let alone = Routed::run(isa, logits.mat().row_range(t..t + 1), 3, 0, 0);
        let row = u32::try_from(t).expect("500 rows");
        let mine: Vec<_> = slots.iter().filter(|slot| slot.1 == row).map(|slot| (slot.0, slot.2.to_bits())).collect();
        assert_eq!(mine, alone.slots().iter().map(|slot| (slot.0, slot.2.to_bits())).collect::<Vec<_>>());
        assert_eq!(together.probabilities[t], alone.probabilities[0]);
    }
}

for_each_isa!(
    route_has_the_right_probabilities,
    route_follows_its_probabilities,
    route_of_a_row_is_the_same_among_500
    => every
);

#[test]
fn route_rejects_impossible_counts() {
    let mut logits = Guarded::new(2, 4, 0, 0);
    let mut error = |top_k, slots| {
        let (mut starts, mut rows, mut weights) = ([0; 5], [0; 8], [0.0; 8]);
        let mut routing = Routing { starts: &mut starts, rows: &mut rows[..slots], weights: &mut weights[..slots] };
        route(Isa::SCALAR, logits.mat(), top_k, &mut routing).unwrap_err().arg
    };
    assert_eq!(error(0, 0), "top_k");
    assert_eq!(error(5, 8), "top_k");
    assert_eq!(error(2, 3), "routing.rows");
}

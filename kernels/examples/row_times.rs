//! Times the row operations at the base model's shapes on every back-end: microseconds, the fastest of many runs.

use std::hint::black_box;
use std::time::Instant;

use umo_kernels::activation::{Activation, apply, argmax, softmax};
use umo_kernels::experts::{Routing, route};
use umo_kernels::norm::{channel_affine, channel_sums, layer_norm, rms_norm};
use umo_kernels::quantize::quantize_rows;
use umo_kernels::{Isa, Mat, MatMut};

const ROWS: usize = 256;
const DIM: usize = 768;
const EXPERTS: usize = 4;

fn fastest(mut call: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        call();
        start.elapsed().as_secs_f64() * 1e6
    };
    (0..400).map(time).fold(f64::INFINITY, f64::min)
}

fn dense(y: &mut [f32]) -> MatMut<'_, f32> {
    MatMut::new(y, ROWS, DIM).expect("sized above")
}

fn main() {
    let x: Vec<f32> = (0..ROWS * DIM).map(|i| ((i * 7_919) % 2_001) as f32 / 500.0 - 2.0).collect();
    let (weight, bias) = (&x[..DIM], &x[DIM..2 * DIM]);
    let mut y = x.clone();
    let mut steps = vec![0; ROWS * DIM];
    let mut scale = vec![0.0; ROWS];
    let (mut sum, mut squares) = (vec![0.0; DIM], vec![0.0; DIM]);
    let (mut starts, mut rows, mut weights) = (vec![0; EXPERTS + 1], vec![0; ROWS], vec![0.0; ROWS]);
    let mat = || Mat::new(&x, ROWS, DIM).expect("sized above");
    println!("{ROWS} x {DIM}; softmax and argmax of 1024, routing of {EXPERTS} experts");
    for isa in Isa::available() {
        let mut show = |op: &str, call: &mut dyn FnMut(&mut [f32])| {
            println!("{op}/{}: {:.2}", isa.name(), fastest(|| call(black_box(&mut y))));
        };
        show("rms_norm", &mut |y| rms_norm(isa, mat(), weight, 1e-6, dense(y)).expect("shapes agree"));
        show("layer_norm", &mut |y| layer_norm(isa, mat(), weight, bias, 1e-5, dense(y)).expect("shapes agree"));
        show("channel_sums", &mut |_| channel_sums(isa, mat(), &mut sum, &mut squares).expect("shapes agree"));
        show("channel_affine", &mut |y| {
            y.copy_from_slice(&x);
            channel_affine(isa, dense(y), weight, bias).expect("shapes agree");
        });
        show("gelu", &mut |y| {
            y.copy_from_slice(&x);
            apply(isa, Activation::Gelu, y);
        });
        show("quantize_rows", &mut |_| {
            let steps = MatMut::new(&mut steps, ROWS, DIM).expect("sized above");
            quantize_rows(isa, mat(), steps, &mut scale).expect("shapes agree");
        });
        show("softmax", &mut |y| {
            y[..1024].copy_from_slice(&x[..1024]);
            softmax(isa, &mut y[..1024]);
        });
        show("argmax", &mut |y| {
            black_box(argmax(isa, &y[..1024]));
        });
        show("route", &mut |y| {
            y[..ROWS * EXPERTS].copy_from_slice(&x[..ROWS * EXPERTS]);
            let logits = MatMut::new(y, ROWS, EXPERTS).expect("sized above");
            let mut routing = Routing { starts: &mut starts, rows: &mut rows, weights: &mut weights };
            route(isa, logits, 1, &mut routing).expect("shapes agree");
        });
    }
}

//! Times `attention_f32` on requests from standard input, so that it can alternate with a peer.
//!
//! Each request is a line `isa queries keys heads head_dim threads repetitions`. The answer is the fastest and the
//! median time in microseconds of one call for all heads, with a bias; heads are distributed evenly over the threads.
//! As in a model, the heads of a whole sequence (as many queries as keys) are column ranges of
//! `[rows, heads * head_dim]`, while a decoder's few rows find keys and values head by head, `[heads, rows, head_dim]`.
//! With `bf16` at the end of the line: a whole sequence with every factor rounded to bfloat16.

use std::hint::spin_loop;
use std::io::BufRead;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use umo_kernels::attention::{Operands, RelativeBias, attention_f32, encoder_attention_bf16, encoder_attention_f32};
use umo_kernels::{Isa, Mat, MatMut};

struct Request {
    isa: Isa,
    queries: usize,
    keys: usize,
    heads: usize,
    head_dim: usize,
    threads: usize,
    repetitions: usize,
    rounded: bool,
}

fn parse(line: &str) -> Option<Request> {
    let mut words = line.split_whitespace();
    let isa = Isa::from_name(words.next()?)?;
    let mut number = || words.next()?.parse().ok();
    Some(Request {
        isa,
        queries: number()?,
        keys: number()?,
        heads: number()?,
        head_dim: number()?,
        threads: number()?,
        repetitions: number()?,
        rounded: words.next() == Some("bf16"),
    })
}

/// Varying numbers in -1..1, with one extra cache line.
fn noise(len: usize) -> Vec<f32> {
    (0..len + 16).map(|i| ((i * 7_919) % 2_001) as f32 / 1_000.0 - 1.0).collect()
}

/// Index of the first cache line: a model's buffers are aligned.
fn line(data: &[f32]) -> usize {
    data.as_ptr().align_offset(64)
}

fn main() {
    for line in std::io::stdin().lock().lines() {
        let line = line.expect("standard input is text");
        let Some(request) = parse(&line) else {
            println!("unknown: {line}");
            continue;
        };
        let mut times = measure(&request);
        times.sort_by(f64::total_cmp);
        println!("{:.2} {:.2}", times[0], times[times.len() / 2]);
    }
}

/// Microseconds of each repetition.
fn measure(request: &Request) -> Vec<f64> {
    let &Request { isa, queries, keys, heads, head_dim, threads, repetitions, rounded } = request;
    let dim = heads * head_dim;
    let (q, k, v) = (noise(queries * dim), noise(keys * dim), noise(keys * dim));
    let biases = noise(heads * (queries + keys));
    let mut y = noise(queries * dim);
    let start = line(&y);
    let mut rest = MatMut::new(&mut y[start..], queries, dim).expect("sized above");
    let mut shares = Vec::new();
    for t in 0..threads {
        let share = heads * t / threads..heads * (t + 1) / threads;
        let (mine, after) = rest.split_columns(share.len() * head_dim);
        shares.push((share, mine));
        rest = after;
    }
    fn placed(data: &[f32], rows: usize, dim: usize) -> Mat<'_, f32> {
        Mat::new(&data[line(data)..], rows, dim).expect("sized above")
    }
    let attention = if rounded { encoder_attention_bf16 } else { encoder_attention_f32 };
    let cached = |data, head| placed(data, heads, keys * head_dim).row(head);
    let work = |heads: std::ops::Range<usize>, y: &mut MatMut<f32>| {
        let mut y = y.reborrow();
        for head in heads {
            let columns = head * head_dim..(head + 1) * head_dim;
            let q = placed(&q, queries, dim).columns(columns.clone());
            let bias = RelativeBias { values: &biases[head * (queries + keys)..], origin: queries };
            let (mine, after) = y.split_columns(head_dim);
            if queries == keys {
                let [k, v] = [&k, &v].map(|data| placed(data, keys, dim).columns(columns.clone()));
                attention(isa, Operands::new(q, k, v, 0.125).biased(bias), mine).expect("shapes agree");
            } else {
                let of = |data| Mat::new(cached(data, head), keys, head_dim).expect("sized above");
                attention_f32(isa, Operands::new(q, of(&k), of(&v), 0.125).biased(bias), mine).expect("shapes agree");
            }
            y = after;
        }
    };
    let (started, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    std::thread::scope(|scope| {
        let mut shares = shares.into_iter();
        let (mine, mut my_y) = shares.next().expect("at least one thread");
        for (share, mut y) in shares {
            let (started, finished, work) = (&started, &finished, &work);
            scope.spawn(move || {
                for turn in 1..=repetitions {
                    while started.load(Ordering::Acquire) < turn {
                        spin_loop();
                    }
                    work(share.clone(), &mut y);
                    finished.fetch_add(1, Ordering::Release);
                }
            });
        }
        let mut time = |turn: usize| {
            let start = Instant::now();
            started.store(turn, Ordering::Release);
            work(mine.clone(), &mut my_y);
            while finished.load(Ordering::Acquire) < turn * (threads - 1) {
                spin_loop();
            }
            start.elapsed().as_secs_f64() * 1e6
        };
        (1..=repetitions).map(&mut time).collect()
    })
}

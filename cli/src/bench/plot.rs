//! Plots the chunks' times: a histogram and a timeline.

use std::error::Error;

use plotters::coord::Shift;
use plotters::prelude::*;

use umo_self_test::speed::quantile;

use super::report::Report;

const SIZE: (u32, u32) = (960, 640);
/// Bars of the histogram.
const BARS: usize = 40;
const INK: RGBColor = RGBColor(40, 40, 48);
const BAR: RGBColor = RGBColor(58, 110, 165);
const MARK: RGBColor = RGBColor(200, 80, 50);

/// Part of the picture.
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws the report as SVG.
pub(super) fn draw(report: &Report) -> Result<String, Box<dyn Error>> {
    let mut svg = String::new();
    fill(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area(), report)?;
    Ok(svg)
}

fn fill(root: &Area, report: &Report) -> Result<(), Box<dyn Error>> {
    let times: Vec<f64> = report.chunks.iter().map(|time| 1e3 * time.as_secs_f64()).collect();
    let [p50, p99] = [0.5, 0.99].map(|share| 1e3 * quantile(&report.chunks, share).as_secs_f64());
    let title = format!(
        "{}, {} threads, {} keyframes: {} chunks, median {p50:.1} ms, 99 % within {p99:.1} ms",
        report.model,
        report.threads,
        report.target,
        times.len()
    );
    root.fill(&WHITE)?;
    let (upper, lower) = root.split_vertically(SIZE.1 / 2);
    histogram(&upper, title, &times, [(p50, "p50"), (p99, "p99")])?;
    timeline(&lower, &times, p50)?;
    Ok(root.present()?)
}

/// Draws how many chunks took how long, with the quantiles `marks`.
fn histogram(area: &Area, title: String, times: &[f64], marks: [(f64, &'static str); 2]) -> Result<(), Box<dyn Error>> {
    let least = times.iter().copied().fold(f64::INFINITY, f64::min);
    let (from, to) = (0.95 * least, 1.05 * longest(times));
    let width = (to - from) / BARS as f64;
    let mut counts = [0_usize; BARS];
    for time in times {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a bar's number")]
        let bar = (((time - from) / width) as usize).min(BARS - 1);
        counts[bar] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(1);
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 18).into_font().color(&INK))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(from..to, 0.0..1.1 * highest as f64)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("ms a chunk")
        .y_desc("chunks")
        .draw()?;
    chart.draw_series(counts.iter().enumerate().map(|(i, &count)| {
        let left = from + i as f64 * width;
        Rectangle::new([(left, 0.0), (left + 0.9 * width, count as f64)], BAR.filled())
    }))?;
    for (mark, name) in marks {
        chart
            .draw_series([PathElement::new(vec![(mark, 0.0), (mark, 1.08 * highest as f64)], MARK.stroke_width(1))])?;
        let style = ("sans-serif", 13).into_font().color(&MARK);
        chart.draw_series([Text::new(name, (mark, 1.08 * highest as f64), style)])?;
    }
    Ok(())
}

/// Draws the time of each chunk, with a line at the median.
fn timeline(area: &Area, times: &[f64], median: f64) -> Result<(), Box<dyn Error>> {
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..times.len() as f64, 0.0..1.05 * longest(times))?;
    chart.configure_mesh().disable_x_mesh().light_line_style(TRANSPARENT).x_desc("chunk").y_desc("ms").draw()?;
    chart
        .draw_series(times.iter().enumerate().map(|(i, &time)| Circle::new((i as f64 + 0.5, time), 2, BAR.filled())))?;
    let line = vec![(0.0, median), (times.len() as f64, median)];
    chart.draw_series([PathElement::new(line, MARK.stroke_width(1))])?;
    Ok(())
}

fn longest(times: &[f64]) -> f64 {
    times.iter().copied().fold(0.0, f64::max)
}

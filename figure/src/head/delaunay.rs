//! Delaunay triangulation of points in the plane (Bowyer 1981, Watson 1981).

type Point = [f64; 2];

/// A triangle, counter-clockwise, with its circumcircle.
struct Triangle {
    corners: [usize; 3],
    centre: Point,
    /// Squared.
    radius: f64,
}

/// Delaunay triangulation of `points`, counter-clockwise. Points must be distinct.
pub(super) fn triangulate(points: &[Point]) -> Vec<[usize; 3]> {
    let count = points.len();
    let mut all = points.to_vec();
    // A triangle that contains all points.
    all.extend([[-10.0, -10.0], [10.0, -10.0], [0.0, 15.0]]);
    let mut triangles = vec![circled(&all, [count, count + 1, count + 2])];
    for (at, &point) in points.iter().enumerate() {
        let inside = |t: &Triangle| (point[0] - t.centre[0]).powi(2) + (point[1] - t.centre[1]).powi(2) < t.radius;
        let mut edges: Vec<[usize; 2]> = Vec::new();
        triangles.retain(|triangle| {
            let gone = inside(triangle);
            if gone {
                let [a, b, c] = triangle.corners;
                edges.extend([[a, b], [b, c], [c, a]]);
            }
            !gone
        });
        // An edge shared by two removed triangles is inside the hole.
        for &[a, b] in &edges {
            if !edges.contains(&[b, a]) {
                triangles.push(circled(&all, [a, b, at]));
            }
        }
    }
    let own = triangles.into_iter().map(|t| t.corners).filter(|corners| corners.iter().all(|&c| c < count));
    own.collect()
}

fn circled(points: &[Point], corners: [usize; 3]) -> Triangle {
    let [a, b, c] = corners.map(|i| points[i]);
    let (bx, by, cx, cy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
    let twice = 2.0 * (bx * cy - by * cx);
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    let (x, y) = ((cy * b2 - by * c2) / twice, (bx * c2 - cx * b2) / twice);
    Triangle { corners, centre: [a[0] + x, a[1] + y], radius: x * x + y * y }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_point_is_inside_a_circumcircle() {
        let points: Vec<Point> = (0..60_u32)
            .map(|i| {
                let (a, b) = (i.wrapping_mul(2_654_435_761) >> 8, i.wrapping_mul(40_503) % 977);
                [f64::from(a % 1009) / 1009.0, f64::from(b) / 977.0]
            })
            .collect();
        let triangles = triangulate(&points);
        assert!(triangles.len() > 60);
        for corners in triangles {
            let t = circled(&points, corners);
            let [a, b, c] = corners.map(|i| points[i]);
            assert!((b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0]), "counter-clockwise");
            for (at, p) in points.iter().enumerate() {
                let away = (p[0] - t.centre[0]).powi(2) + (p[1] - t.centre[1]).powi(2);
                assert!(corners.contains(&at) || away >= t.radius * (1.0 - 1e-9));
            }
        }
    }
}

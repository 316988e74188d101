//! Search for the least value of a function of the unit cube.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::mix::permuted;

/// Weight of the differences, and probability of a coordinate to be crossed.
const WEIGHT: f64 = 0.6;
const CROSSED: f64 = 0.9;
/// Smallest and largest population, and members per coordinate.
const POPULATION: [usize; 2] = [12, 64];
const PER_COORDINATE: usize = 6;

/// Searches for the point of least value by differential evolution, current-to-best/1/bin [Storn and Price 1997]; `values` is
/// asked for the values of whole generations, `most` points in all.
///
/// The first generation is a Latin hypercube, and all corners where these are at most half of it; least values are often
/// at corners, for which reason a coordinate beyond the cube is put on its face.
///
/// # Errors
/// The first error of `values`.
pub fn minimise<E>(
    dimensions: usize,
    most: usize,
    rng: &mut ChaCha8Rng,
    mut values: impl FnMut(&[Vec<f64>]) -> Result<Vec<f64>, E>,
) -> Result<(), E> {
    let size = (PER_COORDINATE * dimensions).clamp(POPULATION[0], POPULATION[1]).min(most);
    let keys: Vec<u64> = (0..dimensions).map(|_| rng.random()).collect();
    let start =
        |i: usize, d: usize, jitter: f64| (permuted(i as u64, size as u64, keys[d]) as f64 + jitter) / size as f64;
    let mut points: Vec<Vec<f64>> =
        (0..size).map(|i| (0..dimensions).map(|d| start(i, d, rng.random())).collect()).collect();
    for (point, corner) in points.iter_mut().zip(corners(dimensions, size / 2)) {
        *point = corner;
    }
    let mut scores = values(&points)?;
    let mut left = most - size;
    while left > 0 {
        let best = (0..size).min_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
        let trials: Vec<Vec<f64>> = (0..size.min(left)).map(|i| trial(&points, (i, best), rng)).collect();
        left -= trials.len();
        for ((i, trial), score) in trials.iter().enumerate().zip(values(&trials)?) {
            if score <= scores[i] {
                (points[i], scores[i]) = (trial.clone(), score);
            }
        }
    }
    Ok(())
}

/// Corners of the unit cube, if there are at most `most`; none otherwise.
fn corners(dimensions: usize, most: usize) -> impl Iterator<Item = Vec<f64>> {
    let count = 1_usize.checked_shl(dimensions as u32).filter(|count| *count <= most).unwrap_or(0);
    (0..count).map(move |corner| (0..dimensions).map(|d| (corner >> d & 1) as f64).collect())
}

fn trial(points: &[Vec<f64>], (i, best): (usize, usize), rng: &mut ChaCha8Rng) -> Vec<f64> {
    let dimensions = points[i].len();
    let [a, b] = [0, 1].map(|_| rng.random_range(0..points.len()));
    let certain = rng.random_range(0..dimensions.max(1));
    // A drawn weight keeps populations from collapsing onto a line.
    let weight = WEIGHT * (0.5 + rng.random::<f64>());
    (0..dimensions)
        .map(|d| {
            if d != certain && rng.random::<f64>() >= CROSSED {
                return points[i][d];
            }
            let moved =
                points[i][d] + WEIGHT * (points[best][d] - points[i][d]) + weight * (points[a][d] - points[b][d]);
            moved.clamp(0.0, 1.0)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    fn least(dimensions: usize, most: usize, f: impl Fn(&[f64]) -> f64) -> (f64, Vec<f64>, usize) {
        let (mut best, mut count) = ((f64::INFINITY, Vec::new()), 0);
        minimise(dimensions, most, &mut ChaCha8Rng::seed_from_u64(5), |points| {
            count += points.len();
            let values: Vec<f64> = points.iter().map(|p| f(p)).collect();
            for (value, point) in values.iter().zip(points) {
                if *value < best.0 {
                    best = (*value, point.clone());
                }
            }
            Ok::<_, ()>(values)
        })
        .unwrap();
        (best.0, best.1, count)
    }

    #[test]
    fn least_values_are_found_inside_and_in_corners() {
        let sphere = least(4, 1500, |x| x.iter().map(|x| (x - 0.3).powi(2)).sum());
        assert!(sphere.0 < 1e-4 && sphere.2 == 1500, "{sphere:?}");
        let corner = least(5, 600, |x| -x[0] + x[1] - x[2] + x[3] - x[4]);
        assert_eq!(corner.0, -3.0, "{corner:?}");
        // Many local minima [Rastrigin 1974], the least at 0.4.
        let wavy = |x: &[f64]| {
            x.iter()
                .map(|x| {
                    let z = 10.24 * (x - 0.4);
                    z * z - 10.0 * (std::f64::consts::TAU * z).cos() + 10.0
                })
                .sum::<f64>()
        };
        let found = least(2, 3000, wavy);
        assert!(found.0 < 0.1, "{found:?}");
    }

    #[test]
    fn few_points_and_infinite_values_are_no_harm() {
        assert_eq!(least(3, 5, |x| x[0]).2, 5);
        // Two coordinates have four corners, of which one is the least of what is monotone.
        assert_eq!(least(2, 12, |x| x[0] - x[1]).0, -1.0);
        let half = least(2, 400, |x| if x[0] < 0.5 { f64::INFINITY } else { x[0] });
        assert!(half.0 < 0.51, "{half:?}");
    }
}

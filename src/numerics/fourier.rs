//! Discrete Fourier transform of real series.

/// |X_k|² of X_k = Σ_j x_j·e^(−2πi·jk/n), k = 0 … n/2, in the unit of `series` squared; empty without values.
pub fn power(mut series: Vec<f64>) -> Vec<f64> {
    if series.is_empty() {
        return Vec::new();
    }
    let transform = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(series.len());
    let mut lines = transform.make_output_vec();
    match transform.process(&mut series, &mut lines) {
        Ok(()) => lines.iter().map(|z| z.norm_sqr()).collect(),
        Err(_) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_power_of_a_short_series_is_computed_by_hand() {
        // X = 10, −2 + 2i, −2.
        let expected = [100.0, 8.0, 4.0];
        let power = super::power(vec![1.0, 2.0, 3.0, 4.0]);
        assert!(power.iter().zip(expected).all(|(p, e)| (p - e).abs() < 1e-12) && power.len() == 3);
        assert!(super::power(Vec::new()).is_empty());
    }
}

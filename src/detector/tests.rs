use super::*;

const PLAIN: Detector =
    Detector { photons: 1.0, pulses: 1, efficiency: 1.0, dark_rate: 0.0, jitter: 0.0, blind: Blind::Never };

fn bins(count: usize, width: f64) -> Bins {
    Bins::new((0..count).map(|k| [k, k + 1].map(|edge| width * edge as f64)).collect()).unwrap()
}

/// Mean and variance of the counts in each gate over many seeds.
fn moments(detector: Detector, means: &[f64], bins: &Bins, seeds: u64) -> Vec<(f64, f64)> {
    let all: Vec<Vec<f64>> =
        (0..seeds).map(|seed| detector.counts(means, &vec![0.0; means.len()], bins, seed)).collect();
    let n = seeds as f64;
    let of_gate = |k: usize| {
        let mean = all.iter().map(|counts| counts[k]).sum::<f64>() / n;
        (mean, all.iter().map(|counts| (counts[k] - mean).powi(2)).sum::<f64>() / (n - 1.0))
    };
    (0..means.len()).map(of_gate).collect()
}

#[test]
fn means_hold_light_background_and_dark_counts() {
    let bins = bins(2, METRES_PER_NS);
    let detector = Detector { photons: 1e3, efficiency: 0.3, dark_rate: 5e6, ..PLAIN };
    // A gate of 1 ns: 0.3 * 1000 * (light + 1e9 * 0.01) + 0.005.
    let means = detector.means([0.0, 2.0].into_iter(), 1e7, &bins);
    assert!((means[0] - 3.005).abs() < 1e-9 && (means[1] - 603.005).abs() < 1e-9, "{means:?}");
    // Of a gate with half the weight, the light has the weight already.
    let bins = bins.weighted(vec![METRES_PER_NS, 0.5 * METRES_PER_NS]).unwrap();
    let means = detector.means([0.0, 2.0].into_iter(), 1e7, &bins);
    assert!((means[0] - 3.005).abs() < 1e-9 && (means[1] - 601.5025).abs() < 1e-9, "{means:?}");
    assert!(bins.weighted(vec![1.0, f64::NAN]).is_err());
}

#[test]
fn counts_without_dead_time_are_poisson() {
    let bins = bins(3, 1.0);
    let means = [0.02, 5.0, 0.0];
    for ((mean, variance), expected) in
        moments(Detector { pulses: 50, ..PLAIN }, &means, &bins, 4000).into_iter().zip(means)
    {
        let expected = 50.0 * expected;
        // Five standard deviations of the mean; the variance has a relative error of about sqrt(2 / 4000).
        assert!((mean - expected).abs() <= 5.0 * (expected / 4000.0).sqrt(), "{mean} {expected}");
        assert!((variance - expected).abs() <= 0.13 * expected, "{variance} {expected}");
    }
}

#[test]
fn huge_counts_are_poisson_too() {
    let mean = 1e22;
    let [(found, variance)] = moments(PLAIN, &[mean], &bins(1, 1.0), 4000)[..] else { panic!("one gate") };
    assert!((found - mean).abs() <= 5.0 * (mean / 4000.0).sqrt(), "{found}");
    assert!((variance / mean - 1.0).abs() <= 0.13, "{variance}");
    for (pulses, mean) in [(1, f64::INFINITY), (u64::MAX, f64::MAX)] {
        assert!(!Detector { pulses, ..PLAIN }.counts(&[mean], &[0.0], &bins(1, 1.0), 1)[0].is_finite());
    }
}

#[test]
fn means_that_cannot_be_drawn_are_refused() {
    let check =
        |blind, mean: f64| Detector { blind, ..PLAIN }.check(&[mean, mean], &bins(2, 1.0)).map_err(|e| e.to_string());
    for blind in [Blind::Never, Blind::UntilNextPulse, Blind::For(0.1)] {
        // A dead time bounds the number of counts, however bright the light is.
        assert!(check(blind, 1e300).is_ok());
        assert!(check(blind, f64::MAX).unwrap_err().contains("lower --photons"));
    }
    let counts = Detector { blind: Blind::For(0.1), ..PLAIN }.counts(&[1e300; 2], &[0.0; 2], &bins(2, 1.0), 1);
    assert!((9.0..=11.0).contains(&counts[0]) && (9.0..=11.0).contains(&counts[1]), "{counts:?}");
    assert!(check(Blind::For(1e-30), 1e3).is_ok());
    assert!(check(Blind::For(1e-30), 1e18).unwrap_err().contains("up to 2.0e18 photons per pulse"));
}

#[test]
fn the_first_photon_hides_later_ones() {
    let bins = bins(3, 1.0);
    let means = [0.5, 1.0, 2.0];
    let detector = Detector { pulses: 1000, blind: Blind::UntilNextPulse, ..PLAIN };
    let laws = [1.0 - (-0.5f64).exp(), (-0.5f64).exp() - (-1.5f64).exp(), (-1.5f64).exp() - (-3.5f64).exp()];
    for ((mean, variance), p) in moments(detector, &means, &bins, 2000).into_iter().zip(laws) {
        assert!((mean - 1000.0 * p).abs() < 5.0 * (1000.0 * p * (1.0 - p) / 2000.0).sqrt(), "{mean} {p}");
        assert!((variance / (1000.0 * p * (1.0 - p)) - 1.0).abs() < 0.17, "{variance} {p}");
    }
    // A dead time longer than all gates has the same distribution, but is simulated photon by photon.
    for ((mean, _), p) in
        moments(Detector { blind: Blind::For(10.0), ..detector }, &means, &bins, 200).into_iter().zip(laws)
    {
        assert!((mean - 1000.0 * p).abs() < 5.0 * (1000.0 * p * (1.0 - p) / 200.0).sqrt(), "{mean} {p}");
    }
}

#[test]
fn a_dead_time_lowers_the_rate() {
    // Two photons per metre, and a dead time of half a metre: after a while 2 / (1 + 2 * 0.5) counts per metre.
    let bins = bins(100, 1.0);
    let detector = Detector { pulses: 3000, blind: Blind::For(0.5), ..PLAIN };
    let counts = detector.counts(&[2.0; 100], &[0.0; 100], &bins, 3);
    let rate = counts[10..].iter().sum::<f64>() / (90.0 * 3000.0);
    assert!((rate - 1.0).abs() < 0.01, "{rate}");
    // The detector is not blind when a pulse begins, so the rate in the first gate is higher.
    assert!(counts[0] > 1.1 * 3000.0, "{}", counts[0]);
    // Light in one gate, and darkness after it.
    let counts =
        Detector { blind: Blind::For(0.1), ..detector }.counts(&[0.0, 3.0, 0.0], &[0.0; 3], &self::bins(3, 1.0), 3);
    assert!(counts[0] == 0.0 && counts[1] > 6000.0 && counts[2] == 0.0, "{counts:?}");
}

#[test]
fn jitter_widens_a_return_by_its_standard_deviation() {
    let bins = bins(400, 0.01);
    let mut means = vec![0.0; 400];
    means[200] = 100.0;
    for blind in [Blind::Never, Blind::For(1e-9)] {
        let detector = Detector { pulses: 1000, jitter: 0.15, blind, ..PLAIN };
        let counts = detector.counts(&means, &[0.0; 400], &bins, 1);
        let total: f64 = counts.iter().sum();
        let mean = counts.iter().enumerate().map(|(k, n)| n * (k as f64 + 0.5) * 0.01).sum::<f64>() / total;
        let variance =
            counts.iter().enumerate().map(|(k, n)| n * ((k as f64 + 0.5) * 0.01 - mean).powi(2)).sum::<f64>() / total;
        // Photons are spread evenly over a gate before the jitter, and counted per gate after it. Each adds width^2 / 12.
        assert!((mean - 2.005).abs() < 0.003 && (total - 1e5).abs() < 2000.0, "{blind:?}: {mean} {total}");
        assert!(
            (variance / (0.15f64.powi(2) + 2.0 * 0.01f64.powi(2) / 12.0) - 1.0).abs() < 0.02,
            "{blind:?}: {variance}"
        );
    }
}

#[test]
fn jitter_keeps_background_and_dark_counts() {
    let bins = bins(20, 0.1);
    let detector =
        Detector { photons: 100.0, pulses: 1_000_000, jitter: 0.3, dark_rate: 1e6, efficiency: 0.5, ..PLAIN };
    let steady = detector.steady_means(1e3, &bins);
    assert_eq!(steady, detector.means([0.0; 20].into_iter(), 1e3, &bins));
    let expected = 1e6 * steady[0];
    let counts = detector.counts(&steady, &steady, &bins, 1);
    assert!(counts.iter().all(|count| (count - expected).abs() < 5.0 * expected.sqrt()), "{expected}: {counts:?}");
    // The light of the last gate is spread. Its middle is 1/6 of a standard deviation from the end, so 57 % stay.
    let mut light = [0.0; 20];
    light[19] = 0.01;
    let counts = detector.counts(&detector.means(light.into_iter(), 1e3, &bins), &steady, &bins, 1);
    let sum = counts.iter().sum::<f64>() - 20.0 * expected;
    assert!((sum / (0.5 * 1e6 * 100.0 * 0.01) - 0.566).abs() < 0.02 && counts[15] > 1.2 * expected, "{sum} {counts:?}");
}

#[test]
fn photons_that_are_measured_too_late_count_for_the_next_pulse() {
    for blind in [Blind::Never, Blind::UntilNextPulse, Blind::For(5.0)] {
        let detector = Detector { pulses: 1_000_000, jitter: 0.1, blind, ..PLAIN };
        let counts = |period| detector.counts(&[0.0, 0.0, 0.0, 0.02], &[0.0; 4], &bins(4, 0.5).repeated(period), 1);
        let (lost, wrapped) = (counts(None), counts(Some(2.0)));
        // The last gate loses 0.1 / sqrt(2 pi) / 0.5 = 8 % of its photons at each end.
        assert!(lost[0] == 0.0 && (wrapped[0] / wrapped.iter().sum::<f64>() - 0.08).abs() < 0.01, "{wrapped:?}");
        assert!((wrapped[0] / wrapped[2] - 1.0).abs() < 0.15, "{wrapped:?}");
        // After a longer period, these photons arrive between the gates.
        assert!(counts(Some(4.0))[0] == 0.0 && counts(Some(1.9)) == lost);
    }
    // An error of many periods spreads evenly.
    let detector = Detector { pulses: 100_000, jitter: 1e9, ..PLAIN };
    let counts = detector.counts(&[0.0, 0.0, 0.0, 1.0], &[0.0; 4], &bins(4, 0.5).repeated(Some(2.0)), 1);
    assert!(counts.iter().all(|count| (count - 25_000.0).abs() < 800.0), "{counts:?}");
}

#[test]
fn first_photons_of_a_bright_gate_are_early() {
    let bins = bins(2, 1.0);
    // A dead time longer than all gates has the same distribution, and is simulated photon by photon.
    let [first, simulated] = [Blind::UntilNextPulse, Blind::For(10.0)].map(|blind| {
        let detector = Detector { pulses: 200_000, jitter: 0.2, blind, ..PLAIN };
        detector.counts(&[3.0, 0.5], &[0.0; 2], &bins, 1)
    });
    for (a, b) in first.iter().zip(&simulated) {
        assert!((a - b).abs() < 5.0 * (a + b).sqrt(), "{first:?} {simulated:?}");
    }
}

#[test]
fn gates_that_overlap_are_exposures_of_their_own() {
    let jitter = Detector { jitter: 0.1, ..PLAIN };
    let blind = |blind| Detector { blind, ..PLAIN };
    for gates in [vec![[0.0, 2.0], [1.0, 3.0]], vec![[2.0, 3.0], [0.0, 1.0]], vec![[0.0, f64::INFINITY]; 2]] {
        let bins = Bins::new(gates).unwrap();
        assert_eq!(PLAIN.check_gates(&bins, false).map_err(|e| e.to_string()), Ok(()));
        for (detector, flags) in [
            (jitter, "--jitter"),
            (blind(Blind::UntilNextPulse), "--first-photon"),
            (Detector { blind: Blind::For(1.0), ..jitter }, "--jitter and --dead-time"),
        ] {
            let error = detector.check_gates(&bins, false).unwrap_err().to_string();
            assert!(error.contains(&format!("leave out {flags}, or render with --gates A..B/N")), "{error}");
        }
        // Each gate counts all its light.
        let means = PLAIN.means([1.0, 4.0].into_iter(), 0.0, &bins);
        for ((mean, _), expected) in moments(PLAIN, &means, &bins, 4000).into_iter().zip([1.0, 4.0]) {
            assert!((mean - expected).abs() <= 5.0 * f64::sqrt(expected / 4000.0), "{mean} {expected}");
        }
    }
    // A gate without an end collects daylight for ever.
    let open = Bins::new(vec![[0.0, f64::INFINITY]]).unwrap();
    for (detector, has_background) in [(PLAIN, true), (Detector { dark_rate: 1.0, ..PLAIN }, false)] {
        let error = detector.check_gates(&open, has_background).unwrap_err().to_string();
        assert!(error.contains("leave out --background and --dark-counts"), "{error}");
        assert!(detector.check_gates(&bins(3, 1.0), has_background).is_ok());
    }
    let apart = Bins::new(vec![[0.0, 1.0], [1.0, 2.0], [5.0, 6.0]]).unwrap();
    assert!(jitter.check_gates(&apart, true).is_ok());
    for gates in [vec![], vec![[1.0, 1.0]], vec![[f64::NAN, 1.0]], vec![[-1.0, 1.0]]] {
        assert!(Bins::new(gates).is_err());
    }
}

#[test]
fn a_seed_repeats_its_counts() {
    let bins = bins(20, 0.1);
    for blind in [Blind::Never, Blind::UntilNextPulse, Blind::For(0.05)] {
        let detector = Detector { pulses: 20, jitter: 0.05, blind, ..PLAIN };
        let counts = |seed| detector.counts(&[0.3; 20], &[0.0; 20], &bins, seed);
        assert!(counts(1) == counts(1) && counts(1) != counts(2), "{blind:?}");
        let pulses = detector.pulses as f64;
        assert!(blind != Blind::UntilNextPulse || counts(1).iter().sum::<f64>() <= pulses);
    }
}

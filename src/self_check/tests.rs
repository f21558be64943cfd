use super::*;
use crate::render::Renderer;

fn device() -> Device {
    Device::open(None).expect("these tests need a Vulkan device: run ./setup.sh")
}

const METHOD: Method = Method { estimator: Estimator::Bdpt, sampling: Sampling::Adaptive, rays: Rays::Software };

#[test]
fn a_lamp_that_is_not_as_bright_as_expected_is_found() {
    assert!(matches!(lamp::check(&device(), METHOD, lamp::RADIANCE).unwrap(), Verdict::Right(_)));
    let almost = lamp::RADIANCE - 5.0 * f32::EPSILON;
    assert!(matches!(lamp::check(&device(), METHOD, almost).unwrap(), Verdict::Wrong(_)));
}

/// With one of the rooms. The command line's long test, `every_check_is_ok`, runs all methods and rooms.
#[test]
fn the_checks_of_a_method_are_right() {
    let method = Method { estimator: Estimator::Lcs, ..METHOD };
    let mut outcomes = vec![];
    let cases = &means::cases()[..1];
    check_method(&device(), method, cases, &mut |outcome| outcomes.push(outcome));
    assert_eq!(outcomes.len(), 2 + cases[0].expected.len());
    for Outcome { name, verdict } in outcomes {
        assert!(matches!(verdict, Verdict::Right(_)), "{name}: {verdict:?}");
    }
}

/// Negative control: every expected mean is a fifth too large.
#[test]
fn means_off_by_a_fifth_are_found() {
    let case = &means::cases()[0];
    let settings = METHOD.settings(&case.scene, "light-paths = 2000").unwrap();
    let mut renderer = Renderer::new(&device(), &case.scene, &settings).unwrap();
    for expected_mean in &case.expected {
        let verdict =
            means::ExpectedMean { mean: 1.2 * expected_mean.mean, ..*expected_mean }.check(&mut renderer).unwrap();
        assert!(matches!(verdict, Verdict::Wrong(_)), "{}: {verdict:?}", case.name);
    }
}

use super::*;

const NS: f64 = METRES_PER_NS;

#[test]
fn good_gates() {
    let table = [
        ("12.5m..12.8m", 12.5, 12.8),
        ("12.5..12.8m", 12.5, 12.8),
        ("12.5m..12.8", 12.5, 12.8),
        ("  12.5 m .. 12.8 m ", 12.5, 12.8),
        ("0..30cm", 0.0, 0.3),
        ("1500mm..2m", 1.5, 2.0),
        ("1e3mm..1.5e+0m", 1.0, 1.5),
        ("0.5km..501m", 500.0, 501.0),
        ("250um..1mm", 250e-6, 1e-3),
        ("10ns..11ns", 10.0 * NS, 11.0 * NS),
        ("10..11ns", 10.0 * NS, 11.0 * NS),
        ("500ps..1ns", 0.5 * NS, NS),
        ("1us..1.5us", 1000.0 * NS, 1500.0 * NS),
        ("1µs..1.5μs", 1000.0 * NS, 1500.0 * NS),
        ("12.65m+-0.15m", 12.5, 12.8),
        ("12.65m±15cm", 12.5, 12.8),
        ("12.65+-0.15m", 12.5, 12.8),
        ("1e1m+-5e-1m", 9.5, 10.5),
        ("12.5m+0.3m", 12.5, 12.8),
        ("12.5m+30cm", 12.5, 12.8),
        ("1e+1m+1e+0m", 10.0, 11.0),
        ("0.1m+-0.2m", 0.0, 0.3),
        ("12.5m..inf", 12.5, f64::INFINITY),
        ("0m..inf", 0.0, f64::INFINITY),
        ("0m..1e12km", 0.0, 1e15),
        ("1e-9um..1um", 1e-15, 1e-6),
    ];
    for (text, lo, hi) in table {
        let gate = Gate::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"));
        assert!((gate.lo - lo).abs() <= 1e-12 * (1.0 + lo), "{text}: {gate:?}");
        assert!(gate.hi == hi || (gate.hi - hi).abs() <= 1e-12 * hi, "{text}: {gate:?}");
        assert_eq!(Gate::parse(&gate.to_string()).unwrap(), gate, "{text} does not survive printing");
    }
}

#[test]
fn bad_gates() {
    let table = [
        ("12.5..12.8", "no unit"),
        ("12.5+-0.3", "no unit"),
        ("12.5+0.3", "no unit"),
        ("5..inf", "no unit"),
        ("12.5m", "not an interval"),
        ("", "not an interval"),
        ("12.5m..", "lacks an end"),
        ("..12.5m", "lacks an end"),
        ("12.5m..12.5m", "empty"),
        ("12.5m+-0m", "empty"),
        ("12.5m+0m", "empty"),
        ("12.8m..12.5m", "reversed"),
        ("0m...9m", "three dots"),
        ("12.5m+-(-1m)", "not a number"),
        ("12m+-inf", "begin at a finite"),
        ("inf..12m", "begin at a finite"),
        ("nanm..12m", "not a number"),
        ("1m..NaN", "not a number"),
        ("1e999m..2m", "not a number"),
        ("0m..1e300m", "beyond the maximum"),
        ("1e31m..inf", "beyond the maximum"),
        ("-3m..-1m", "at or before 0"),
        ("-3m..0m", "at or before 0"),
        ("1furlong..2m", "'furlong'"),
        ("1s..2s", "'s'"),
        ("1M..2M", "'M'"),
        ("1m..2m..3m", "not a unit"),
        ("1..2..3m", "not a number"),
        ("one..two", "not a number"),
    ];
    for (text, part) in table {
        let message = Gate::parse(text).expect_err(text).to_string();
        assert!(message.contains(part), "{text}: {message}");
        assert!(message.contains("m.."), "{text}: no example in: {message}");
    }
}

#[test]
fn depth_is_half_the_path_and_a_length() {
    assert_eq!(Gate::parse_depth("6.25m..6.4m").unwrap(), Gate { lo: 12.5, hi: 12.8 });
    assert_eq!(Gate::parse_depth("20m..25m").unwrap(), Gate { lo: 40.0, hi: 50.0 });
    let message = Gate::parse_depth("10ns..11ns").unwrap_err().to_string();
    assert!(message.contains("'ns'") && message.contains("6.25m..6.4m"), "{message}");
    assert!(Gate::parse_depth("1..2").is_err());
}

#[test]
fn the_gate_is_described_in_three_units() {
    let gate = Gate { lo: 12.5, hi: 12.8 };
    assert_eq!(gate.describe(), "gate 12.5-12.8 m = 41.696-42.696 ns = 6.25-6.4 m depth");
    assert_eq!(Gate::OPEN.describe(), "no gate (steady state)");
    assert_eq!(Gate { lo: 100.0, hi: f64::INFINITY }.describe(), "gate 100-inf m = 333.564-inf ns = 50-inf m depth");
    assert_eq!(Gate { lo: 0.0, hi: 1e300 }.describe(), "gate 0-1e300 m = 0-3.335641e300 ns = 0-5e299 m depth");
    assert_eq!(Gate::parse("2e-9m..1e27km").unwrap().to_string(), "2e-9m..1e30m");
    let thin = Gate::parse("1m+0.1mm").unwrap().describe();
    assert!(thin.starts_with("gate 1-1.0001 m = 3.335641-3.335975 ns"), "{thin}");
}

#[test]
fn thin_gates_are_told_apart_by_f32_steps() {
    // Neighbouring f32 numbers in [8, 16) differ by 2^-20.
    let step = 1.0 / f64::from(1 << 20);
    let wide = |n: f64| Gate { lo: 12.5, hi: 12.5 + n * step }.precision(0.0);
    assert_eq!(wide(256.0), GatePrecision::Fine);
    assert_eq!(wide(255.0), GatePrecision::Coarse { ulps: 255.0 });
    assert_eq!(wide(16.0), GatePrecision::Coarse { ulps: 16.0 });
    assert_eq!(wide(15.0), GatePrecision::TooThin { ulps: 15.0 });
    assert!(
        matches!(Gate { lo: 1.0, hi: 1.0 + 16.0 * step }.precision(11.0), GatePrecision::Coarse { ulps } if ulps == 16.0)
    );
    assert_eq!(Gate::OPEN.precision(0.0), GatePrecision::Fine);
    assert!(matches!(Gate { lo: 0.0, hi: 1e300 }.precision(0.0), GatePrecision::TooThin { .. }));
}

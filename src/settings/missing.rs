//! Settings that other renderers have, and taugate lacks or calls by another name.

/// Why there is no setting `name` (with dashes), and what to do instead, as a clause. It names `docs/LIMITS.md` if taugate lacks the
/// setting. `None` for all other names.
pub fn reason(name: &str) -> Option<&'static str> {
    Some(match name {
        "shutter-open" | "shutter-close" | "shutter-speed" | "exposure-time" | "motion-blur" => {
            "say from when to when the shutter is open, with --shutter, like 0..20ms"
        }
        "f-number" | "f-stop" | "fstop" | "aperture-radius" | "focus-distance" | "focal-distance" | "lens"
        | "lens-radius" | "depth-of-field" | "dof" => {
            "give the diameter of the lens with --aperture, like 8mm or f/2.8@35mm, and the distance in focus with --focus"
        }
        "lens-distortion" | "k1" | "k2" | "fisheye" => {
            "give the coefficients of the lens with --distortion, or the file of a calibration with --calibration"
        }
        "focal-length" | "sensor-width" | "sensor-height" => {
            "give the vertical field of view in degrees with --fov, or focal lengths in pixels with --camera-matrix"
        }
        "iso" | "gain" | "noise" | "read-noise" | "quantum-efficiency" => {
            "pixels measure radiance, and taugate detect draws the counts of a detector, with --photons, --efficiency and --dark-counts (docs/LIMITS.md)"
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::plain::home_of;

    #[test]
    fn no_setting_counts_as_missing() {
        for name in ["shutter-open", "f-number", "fisheye", "focal-length", "iso"] {
            assert!(
                reason(name).is_some_and(|reason| reason.contains("docs/LIMITS.md") || reason.contains("--")),
                "{name}"
            );
            assert!(home_of(name).is_none(), "{name} is a setting");
        }
        assert!(reason("spp").is_none());
    }
}

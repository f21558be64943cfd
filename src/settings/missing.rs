//! Settings that other renderers have and taugate lacks.

/// Why there is no setting `name` (with dashes), and what to do instead, as a clause that names `docs/LIMITS.md`. `None` for all other
/// names.
pub fn reason(name: &str) -> Option<&'static str> {
    Some(match name {
        "shutter" | "shutter-open" | "shutter-close" | "shutter-speed" | "exposure-time" | "motion-blur" => {
            "the shutter is open for an instant, so render several moments with --at and average them (docs/LIMITS.md)"
        }
        "f-number" | "f-stop" | "fstop" | "aperture" | "aperture-radius" | "focus" | "focus-distance"
        | "focal-distance" | "lens" | "lens-radius" | "depth-of-field" | "dof" | "vignetting" => {
            "cameras are pinholes or orthographic, so blur the image of a lens yourself (docs/LIMITS.md)"
        }
        "distortion" | "lens-distortion" | "k1" | "k2" | "fisheye" => {
            "cameras are pinholes or orthographic, so distort the image of a lens yourself (docs/LIMITS.md)"
        }
        "focal-length" | "sensor-width" | "sensor-height" => {
            "give the vertical field of view in degrees with --fov; a lens is not simulated (docs/LIMITS.md)"
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
        for name in ["shutter", "f-number", "focus", "distortion", "focal-length", "iso"] {
            assert!(reason(name).is_some_and(|reason| reason.contains("docs/LIMITS.md")), "{name}");
            assert!(home_of(name).is_none(), "{name} is a setting");
        }
        assert!(reason("spp").is_none());
    }
}

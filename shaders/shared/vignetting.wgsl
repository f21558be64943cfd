// Vignetting: the share of the light that reaches the sensor (`src/scene/vignetting.rs`).
#import frame
#import math

// Number of rows of the table.
const VIGNETTING_ROWS = 32u;

// Row `index` of the table: an angle in radians, and a share.
fn vignetting_row(index: u32) -> vec2<f32> {
    let pair = frame.vignetting[index / 2u];
    return select(pair.xy, pair.zw, (index & 1u) == 1u);
}

fn has_vignetting() -> bool {
    return HAS_COS4 || HAS_VIGNETTING_TABLE;
}

// The share of the light along a ray whose direction through the centre of the lens is `to`, with z along the view.
fn vignetting(to: vec3<f32>) -> f32 {
    if (HAS_COS4) {
        return square(to.z * to.z / dot(to, to));
    }
    let angle = atan2(length(to.xy), to.z);
    var share = vignetting_row(0u).y;
    for (var i = 1u; i < VIGNETTING_ROWS; i++) {
        let before = vignetting_row(i - 1u);
        let after = vignetting_row(i);
        if (angle >= before.x) {
            share = mix(before.y, after.y, saturate((angle - before.x) / (after.x - before.x)));
        }
    }
    return share;
}

// The shade points that the sensor subpaths of a tile left, for the kernels that connect them.
#import path

// Texels of PathVertex.
@group(2) @binding(0) var shade_points: texture_1d<u32>;

fn load_shade_point(index: u32) -> PathVertex {
    return load_vertex(shade_points, index);
}

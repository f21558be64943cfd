// The shade points of the sensor subpaths of a tile, for the kernels that connect them.
#import path

// Seven texels per PathVertex.
@group(2) @binding(0) var shade_points: texture_1d<u32>;

fn load_shade_point(index: u32) -> PathVertex {
    let first = 7u * index;
    return unpack_vertex(array<vec4<u32>, 7>(
        textureLoad(shade_points, first, 0),
        textureLoad(shade_points, first + 1u, 0),
        textureLoad(shade_points, first + 2u, 0),
        textureLoad(shade_points, first + 3u, 0),
        textureLoad(shade_points, first + 4u, 0),
        textureLoad(shade_points, first + 5u, 0),
        textureLoad(shade_points, first + 6u, 0),
    ));
}

// The shade points that the sensor subpaths of a tile left, for the kernels that connect them.
#import path

// Texels of PathVertex.
@group(2) @binding(0) var shade_points: texture_1d<u32>;

fn load_shade_point(index: u32) -> PathVertex {
    return unpack_vertex(
        textureLoad(shade_points, 7u * index, 0),
        textureLoad(shade_points, 7u * index + 1u, 0),
        textureLoad(shade_points, 7u * index + 2u, 0),
        textureLoad(shade_points, 7u * index + 3u, 0),
        textureLoad(shade_points, 7u * index + 4u, 0),
        textureLoad(shade_points, 7u * index + 5u, 0),
        textureLoad(shade_points, 7u * index + 6u, 0),
    );
}

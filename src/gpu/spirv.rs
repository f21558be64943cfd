//! Edits the finished SPIR-V, for two features that WGSL and naga do not have: NoContraction and texel buffers.

use spirv::{Capability, Decoration, Dim, Op};

/// Words before the first instruction.
const HEADER: usize = 5;

/// Iterates over all instructions as (operation, words). The words include the first one, which holds length and opcode. An unknown operation is
/// a `Nop`.
fn instructions(words: &[u32]) -> impl Iterator<Item = (Op, &[u32])> {
    let mut at = HEADER;
    std::iter::from_fn(move || {
        let first = *words.get(at)?;
        let length = ((first >> 16) as usize).max(1);
        let instruction = &words[at..(at + length).min(words.len())];
        at += length;
        Some((Op::from_u32(first & 0xffff).unwrap_or(Op::Nop), instruction))
    })
}

/// Decorates every float operation with NoContraction, which naga does not emit. Without the decoration, a driver may use a fused
/// multiply-add for one of two triangles that share an edge, and rays could pass between them.
pub fn forbid_contraction(words: &[u32]) -> Vec<u32> {
    use Op::{Dot, FAdd, FDiv, FMul, FSub, MatrixTimesVector, VectorTimesMatrix, VectorTimesScalar};
    const FLOAT_OPERATIONS: [Op; 8] =
        [FAdd, FSub, FMul, FDiv, VectorTimesScalar, VectorTimesMatrix, MatrixTimesVector, Dot];
    const TYPES: std::ops::RangeInclusive<u32> = Op::TypeVoid as u32..=Op::TypeForwardPointer as u32;
    let float_operations = || instructions(words).filter(|(operation, _)| FLOAT_OPERATIONS.contains(operation));
    let decoration = |f: &[u32]| [(3 << 16) | Op::Decorate as u32, f[2], Decoration::NoContraction as u32];
    let mut out = words[..HEADER].to_vec();
    let mut decorated = false;
    for (operation, instruction) in instructions(words) {
        // In SPIR-V all decorations come before the first type.
        if !decorated && TYPES.contains(&(operation as u32)) {
            out.extend(float_operations().flat_map(|(_, f)| decoration(f)));
            decorated = true;
        }
        out.extend_from_slice(instruction);
    }
    out
}

/// Turns one-dimensional sampled images into uniform texel buffers, for which WGSL has no type. So a `texture_1d<u32>` is an
/// array of 16-byte texels in an ordinary buffer. The reason is speed: for each thread, lavapipe fetches a texel with one 128-bit
/// load and no branch. From a storage buffer, each word costs a branch, a bounds check and an insertion into the vector.
pub fn texel_buffers(words: &[u32]) -> Vec<u32> {
    // Instruction, result type, result, image, coordinate; image operands (the level) follow.
    const FETCH_WITHOUT_LEVEL: usize = 5;
    // Instruction, result type, result, image; the level follows.
    const QUERY_WITHOUT_LEVEL: usize = 4;
    let mut out = words[..HEADER].to_vec();
    for (operation, instruction) in instructions(words) {
        match operation {
            Op::Capability if instruction[1] == Capability::Sampled1D as u32 => {
                out.extend([instruction[0], Capability::SampledBuffer as u32]);
            }
            Op::TypeImage if instruction[3] == Dim::Dim1D as u32 => {
                out.extend_from_slice(&instruction[..3]);
                out.push(Dim::DimBuffer as u32);
                out.extend_from_slice(&instruction[4..]);
            }
            // Kernels have no other images, so every fetch and every size query is of a texel buffer.
            Op::ImageFetch => {
                out.push(((FETCH_WITHOUT_LEVEL as u32) << 16) | Op::ImageFetch as u32);
                out.extend_from_slice(&instruction[1..FETCH_WITHOUT_LEVEL]);
            }
            Op::ImageQuerySizeLod => {
                out.push(((QUERY_WITHOUT_LEVEL as u32) << 16) | Op::ImageQuerySize as u32);
                out.extend_from_slice(&instruction[1..QUERY_WITHOUT_LEVEL]);
            }
            _ => out.extend_from_slice(instruction),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPENING: [u32; HEADER] = [0x0723_0203, 0x10300, 0, 9, 0];

    fn module(instructions: &[&[u32]]) -> Vec<u32> {
        let encode = |i: &&[u32]| [&[((i.len() as u32) << 16) | i[0]], &i[1..]].concat();
        [OPENING.to_vec(), instructions.iter().flat_map(encode).collect()].concat()
    }

    #[test]
    fn every_float_operation_is_decorated_before_the_first_type() {
        let (ty, add, int) = ([22, 1, 32], [129, 1, 7, 5, 6], [128, 2, 8, 3, 4]);
        let expected = module(&[&[17, 1], &[71, 7, 42], &ty, &add, &int]);
        assert_eq!(forbid_contraction(&module(&[&[17, 1], &ty, &add, &int])), expected);
    }

    #[test]
    fn a_one_dimensional_image_becomes_a_texel_buffer() {
        let before = module(&[&[17, 43], &[25, 3, 2, 0, 0, 0, 0, 1, 0], &[95, 4, 8, 5, 6, 2, 7], &[103, 4, 9, 5, 7]]);
        let after = module(&[&[17, 46], &[25, 3, 2, 5, 0, 0, 0, 1, 0], &[95, 4, 8, 5, 6], &[104, 4, 9, 5]]);
        assert_eq!(texel_buffers(&before), after);
        // Other capabilities and operations stay.
        let other = module(&[&[17, 1], &[129, 1, 7, 5, 6]]);
        assert_eq!(texel_buffers(&other), other);
    }
}

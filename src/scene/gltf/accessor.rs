//! Checked reading of accessors: all elements are known to lie inside their buffer before the first one is read.

use std::borrow::Cow;

use ::gltf::json::accessor::ComponentType::{self, F32, I8, I16, U8, U16, U32};
use ::gltf::json::accessor::Type;
use ::gltf::json::validation::Checked::Valid;

use super::Checked;
use super::document::Document;

/// Maximum number of elements of an accessor: three corners per triangle of the largest allowed scene.
pub const MAX_ELEMENTS: u64 = 3 * super::mesh::MAX_TRIANGLES;
/// The elements of an accessor without a buffer view are zeros. Their number may exceed the bytes of all buffers by this number:
/// the other attributes of a large mesh take more than one byte per vertex, but a file of a few bytes must not fill the memory.
const FREE_ZEROS: u64 = 1 << 18;

/// A component type, and whether its integers are normalized, i.e. stand for fractions of their largest value.
pub type Format = (ComponentType, bool);

/// Formats of inverse bind matrices, and of the translations and scales of instances.
pub const FLOAT: &[Format] = &[(F32, false)];
/// Formats of POSITION and TEXCOORD_n. KHR_mesh_quantization allows all types but 32-bit integers.
pub const QUANTIZED: &[Format] = &[
    (F32, false),
    (I8, false),
    (I8, true),
    (U8, false),
    (U8, true),
    (I16, false),
    (I16, true),
    (U16, false),
    (U16, true),
];
/// Formats of NORMAL and TANGENT, and of the rotations of instances.
pub const DIRECTION: &[Format] = &[(F32, false), (I8, true), (I16, true)];
/// Formats of COLOR_n and WEIGHTS_n.
pub const FRACTION: &[Format] = &[(F32, false), (U8, true), (U16, true)];
/// Formats of the values of animated rotations and weights.
pub const ANIMATED: &[Format] = &[(F32, false), (I8, true), (U8, true), (I16, true), (U16, true)];
/// Formats of indices. Whether they are normalized is ignored.
const INDEX: &[Format] = &[(U8, false), (U8, true), (U16, false), (U16, true), (U32, false), (U32, true)];
/// Formats of JOINTS_n.
pub const JOINT: &[Format] = &[(U8, false), (U16, false)];

/// An accessor whose shape, component type and extent are checked.
struct Elements<'a> {
    format: Format,
    count: usize,
    /// Bytes per element.
    size: usize,
    /// Bytes of exactly `count` elements, and the distance between elements in bytes; `None` without a buffer view: all zeros.
    bytes: Option<(Cow<'a, [u8]>, usize)>,
    /// Sparse replacements: element index, below `count`, and the bytes of the element.
    patches: Vec<(usize, &'a [u8])>,
}

impl Document<'_> {
    /// Scalars (`N` = 1), vectors of `N` = 2, 3 or 4 components, or matrices of `N` = 16, column by column. Integers become floats;
    /// normalized ones are mapped to [0, 1], or [-1, 1] if they are signed. `what` names the accessor in messages.
    pub fn vectors<const N: usize>(&self, index: usize, what: &str, allowed: &[Format]) -> Checked<Vec<[f32; N]>> {
        let shape = match N {
            1 => Type::Scalar,
            2 => Type::Vec2,
            3 => Type::Vec3,
            4 => Type::Vec4,
            _ => Type::Mat4,
        };
        let elements = self.elements(index, what, shape, allowed)?;
        Ok(match elements.format {
            (I8, false) => elements.vectors(|bytes| f32::from(i8::from_le_bytes(bytes))),
            (I8, true) => elements.vectors(|bytes| (f32::from(i8::from_le_bytes(bytes)) / 127.0).max(-1.0)),
            (U8, false) => elements.vectors(|bytes| f32::from(u8::from_le_bytes(bytes))),
            (U8, true) => elements.vectors(|bytes| f32::from(u8::from_le_bytes(bytes)) / 255.0),
            (I16, false) => elements.vectors(|bytes| f32::from(i16::from_le_bytes(bytes))),
            (I16, true) => elements.vectors(|bytes| (f32::from(i16::from_le_bytes(bytes)) / 32767.0).max(-1.0)),
            (U16, false) => elements.vectors(|bytes| f32::from(u16::from_le_bytes(bytes))),
            (U16, true) => elements.vectors(|bytes| f32::from(u16::from_le_bytes(bytes)) / 65535.0),
            (U32, _) => elements.vectors(|bytes| u32::from_le_bytes(bytes) as f32),
            (F32, _) => elements.vectors(f32::from_le_bytes),
        })
    }

    /// RGBA in [0, 1] from vectors of 3 or 4 numbers; alpha is 1 if there are 3. Values outside [0, 1] are clamped.
    pub fn colors(&self, index: usize, what: &str) -> Checked<Vec<[f32; 4]>> {
        let has_alpha = self.root.accessors.get(index).is_some_and(|accessor| accessor.type_ == Valid(Type::Vec4));
        let rgba = match has_alpha {
            true => self.vectors::<4>(index, what, FRACTION)?,
            false => self.vectors::<3>(index, what, FRACTION)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect(),
        };
        if rgba.iter().flatten().any(|value| !value.is_finite()) {
            return Err(format!("{what} is not finite; clean the mesh and re-export"));
        }
        Ok(rgba.into_iter().map(|color| color.map(|value| value.clamp(0.0, 1.0))).collect())
    }

    /// Unsigned integers. The caller must check that they are in range of the vertices.
    pub fn indices(&self, index: usize, what: &str) -> Checked<Vec<u32>> {
        let elements = self.elements(index, what, Type::Scalar, INDEX)?;
        Ok(elements.map(unsigned))
    }

    /// Number of elements of an accessor, 1 to [`MAX_ELEMENTS`]. Without data, the limit is lower: see `FREE_ZEROS`.
    pub fn count(&self, index: usize, what: &str) -> Checked<u64> {
        let accessor = (self.root.accessors.get(index))
            .ok_or_else(|| format!("{what} refers to accessor {index}, which does not exist; re-export the file"))?;
        let in_draco = self.draco.count(self, index, what).transpose()?;
        let count = in_draco.unwrap_or(accessor.count.0);
        let has_bytes = in_draco.is_some() || accessor.buffer_view.is_some();
        match count {
            0 => Err(format!("accessor {index} ({what}) has no elements; remove the mesh and re-export")),
            count if count > MAX_ELEMENTS => Err(format!(
                "accessor {index} ({what}) has {count} elements; at most {MAX_ELEMENTS} are read, split the mesh"
            )),
            count if !has_bytes && count > FREE_ZEROS + self.buffer_bytes => {
                Err(format!("accessor {index} ({what}) has no bufferView for its {count} elements; re-export the file"))
            }
            count => Ok(count),
        }
    }

    fn elements(&self, index: usize, what: &str, shape: Type, allowed: &[Format]) -> Checked<Elements<'_>> {
        let count = self.count(index, what)?;
        let name = format!("accessor {index} ({what})");
        let accessor = self.root.accessors.get(index).ok_or_else(|| name.clone())?;
        if accessor.type_ != Valid(shape) {
            return Err(format!("{name} must be of type {}; re-export the file", format!("{shape:?}").to_uppercase()));
        }
        let component = match accessor.component_type {
            Valid(component) if allowed.iter().any(|format| format.0 == component.0) => component.0,
            _ => return Err(format!("{name} has a component type that is not allowed there; re-export the file")),
        };
        let format = (component, accessor.normalized && component != F32);
        if !allowed.contains(&format) {
            let wrong = if accessor.normalized { "normalized" } else { "not normalized" };
            return Err(format!(
                "{name} has integers that are {wrong}, which is not allowed there; re-export the file"
            ));
        }
        if let Some(decoded) = self.draco.bytes(self, index, component, shape.multiplicity(), what) {
            let (component, bytes) = decoded?;
            let size = component.size() * shape.multiplicity();
            let bytes = Some((Cow::Owned(bytes), size));
            return Ok(Elements { format: (component, format.1), count: count as usize, size, bytes, patches: vec![] });
        }
        let size = component.size() * shape.multiplicity();

        let bytes = match accessor.buffer_view {
            None => None,
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let (bytes, stride) = self.region(view.value(), offset, count, size, &name)?;
                Some((Cow::Borrowed(bytes), stride))
            }
        };

        let mut patches = Vec::new();
        if let Some(sparse) = &accessor.sparse {
            let number = sparse.count.0;
            if number == 0 || number > count {
                return Err(format!(
                    "{name} has a sparse count of {number}, but must have 1 to {count}; re-export the file"
                ));
            }
            let Valid(kind) = sparse.indices.component_type else {
                return Err(format!("{name} has sparse indices that are not unsigned integers; re-export the file"));
            };
            let (at, at_stride) = self.region(
                sparse.indices.buffer_view.value(),
                sparse.indices.byte_offset.0,
                number,
                kind.0.size(),
                &format!("{name}, sparse indices"),
            )?;
            let (values, value_stride) = self.region(
                sparse.values.buffer_view.value(),
                sparse.values.byte_offset.0,
                number,
                size,
                &format!("{name}, sparse values"),
            )?;
            for (at, value) in at.chunks(at_stride).zip(values.chunks(value_stride)) {
                let at = unsigned(at.get(..kind.0.size()).unwrap_or(at));
                if u64::from(at) >= count {
                    return Err(format!(
                        "{name} has the sparse index {at}, but only {count} elements; re-export the file"
                    ));
                }
                patches.push((at as usize, value));
            }
        }
        Ok(Elements { format, count: count as usize, size, bytes, patches })
    }

    /// The bytes of `count` elements of `size` bytes, and their stride: `chunks(stride)` yields each element once.
    fn region(&self, view: usize, offset: u64, count: u64, size: usize, name: &str) -> Checked<(&[u8], usize)> {
        let number = view;
        let view = self.view(view, name)?;
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(format!(
                "{name} has elements of {size} bytes but a byteStride of {stride}; re-export the file"
            ));
        }
        let bytes = (count.checked_sub(1))
            .and_then(|gaps| gaps.checked_mul(stride as u64)?.checked_add(size as u64)?.checked_add(offset))
            .and_then(|end| view.bytes.get(usize::try_from(offset).ok()?..usize::try_from(end).ok()?))
            .ok_or_else(|| format!("{name} reaches beyond the end of bufferView {number}; re-export the file"))?;
        Ok((bytes, stride))
    }
}

impl Elements<'_> {
    /// Decodes every element; `decode` gets exactly `size` bytes.
    fn map<T: Clone>(&self, decode: impl Fn(&[u8]) -> T) -> Vec<T> {
        let mut out = match &self.bytes {
            None => vec![decode(&[0; 64][..self.size]); self.count],
            Some((bytes, stride)) => bytes.chunks(*stride).map(|element| decode(&element[..self.size])).collect(),
        };
        for (at, bytes) in &self.patches {
            out[*at] = decode(&bytes[..self.size]);
        }
        out
    }

    /// Decodes every component from its `B` bytes.
    fn vectors<const N: usize, const B: usize>(&self, component: impl Fn([u8; B]) -> f32) -> Vec<[f32; N]> {
        self.map(|bytes| {
            let components = bytes.as_chunks::<B>().0;
            std::array::from_fn(|k| component(components[k]))
        })
    }
}

/// The unsigned integer in 1, 2 or 4 little-endian bytes.
fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

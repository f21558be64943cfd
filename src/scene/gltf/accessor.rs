//! Checked reading of accessors: before the first element is read, all elements are known to lie inside their buffer.

use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked::Valid;

use super::Checked;
use super::document::Document;

/// Maximum number of elements of an accessor: three corners per triangle of the largest allowed scene.
pub const MAX_ELEMENTS: u64 = 3 * super::mesh::MAX_TRIANGLES;
/// Maximum number of elements of an accessor without a buffer view, whose elements are zeros: a file of a few bytes must not fill
/// the memory.
const MAX_ZEROS: u64 = 1 << 24;

/// An accessor whose shape, component type and extent are checked.
struct Elements<'a> {
    component: ComponentType,
    count: usize,
    /// Bytes per element.
    size: usize,
    /// Bytes of exactly `count` elements, and the distance between elements in bytes; `None` without a buffer view: all zeros.
    bytes: Option<(&'a [u8], usize)>,
    /// Sparse replacements: element index, below `count`, and the bytes of the element.
    patches: Vec<(usize, &'a [u8])>,
}

impl Document<'_> {
    /// Vectors of `N` = 2 or 3 floats. Integers of 8 and 16 bits must be marked as normalized; they are mapped to [0, 1]. `what`
    /// names the accessor in messages.
    pub fn vectors<const N: usize>(
        &self,
        index: usize,
        what: &str,
        allowed: &[ComponentType],
    ) -> Checked<Vec<[f32; N]>> {
        let shape = if N == 2 { Type::Vec2 } else { Type::Vec3 };
        let elements = self.elements(index, what, shape, allowed)?;
        Ok(match elements.component {
            ComponentType::U8 => elements.map(|bytes| std::array::from_fn(|k| f32::from(bytes[k]) / 255.0)),
            ComponentType::U16 => elements.map(|bytes| {
                let words = bytes.as_chunks::<2>().0;
                std::array::from_fn(|k| f32::from(u16::from_le_bytes(words[k])) / 65535.0)
            }),
            _ => elements.map(|bytes| {
                let words = bytes.as_chunks::<4>().0;
                std::array::from_fn(|k| f32::from_le_bytes(words[k]))
            }),
        })
    }

    /// Unsigned integers. The caller must check that they are in range of the vertices.
    pub fn indices(&self, index: usize, what: &str) -> Checked<Vec<u32>> {
        use ComponentType::{U8, U16, U32};
        let elements = self.elements(index, what, Type::Scalar, &[U8, U16, U32])?;
        Ok(elements.map(unsigned))
    }

    /// Number of elements of an accessor, 1 to [`MAX_ELEMENTS`].
    pub fn count(&self, index: usize, what: &str) -> Checked<u64> {
        let accessor = (self.root.accessors.get(index))
            .ok_or_else(|| format!("{what} refers to accessor {index}, which does not exist; re-export the file"))?;
        match accessor.count.0 {
            0 => Err(format!("accessor {index} ({what}) has no elements; remove the mesh and re-export")),
            count if count > MAX_ELEMENTS => Err(format!(
                "accessor {index} ({what}) has {count} elements; at most {MAX_ELEMENTS} are read, split the mesh"
            )),
            count => Ok(count),
        }
    }

    fn elements(&self, index: usize, what: &str, shape: Type, allowed: &[ComponentType]) -> Checked<Elements<'_>> {
        let count = self.count(index, what)?;
        let name = format!("accessor {index} ({what})");
        let accessor = self.root.accessors.get(index).ok_or_else(|| name.clone())?;
        if accessor.type_ != Valid(shape) {
            return Err(format!("{name} must be of type {}; re-export the file", format!("{shape:?}").to_uppercase()));
        }
        let component = match accessor.component_type {
            Valid(component) if allowed.contains(&component.0) => component.0,
            _ => {
                return Err(format!(
                    "{name} has a component type that is not allowed there; re-export without quantization"
                ));
            }
        };
        let is_integer = component != ComponentType::F32;
        if is_integer && shape != Type::Scalar && !accessor.normalized {
            return Err(format!("{name} has integers that are not normalized; re-export without quantization"));
        }
        let size = component.size() * shape.multiplicity();

        let bytes = match accessor.buffer_view {
            None if count > MAX_ZEROS => {
                return Err(format!("{name} has no bufferView for its {count} elements; re-export the file"));
            }
            None => None,
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                Some(self.region(view.value(), offset, count, size, &name)?)
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
        Ok(Elements { component, count: count as usize, size, bytes, patches })
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
        let mut out = match self.bytes {
            None => vec![decode(&[0; 16][..self.size]); self.count],
            Some((bytes, stride)) => bytes.chunks(stride).map(|element| decode(&element[..self.size])).collect(),
        };
        for (at, bytes) in &self.patches {
            out[*at] = decode(&bytes[..self.size]);
        }
        out
    }
}

/// The unsigned integer in 1, 2 or 4 little-endian bytes.
fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

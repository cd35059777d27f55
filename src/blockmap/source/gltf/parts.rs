//! Buffers of a glTF file, and what lies in them.

use std::path::Path;

use base64::Engine;
use base64::alphabet;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use glam::DVec3;
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Primitive;
use gltf::texture::Info;
use gltf::{Accessor, Document, Semantic, buffer};

use crate::blockmap::source::collector::Collector;
use crate::blockmap::source::{beside, bytes_beside};

type Told<T> = Result<T, String>;

/// A document with its buffers.
pub(super) struct Parts<'a> {
    pub path: &'a Path,
    document: &'a Document,
    buffers: Vec<Vec<u8>>,
}

impl<'a> Parts<'a> {
    /// `blob` is the buffer within a binary file.
    pub(super) fn read(
        path: &'a Path,
        document: &'a Document,
        blob: Option<Vec<u8>>,
    ) -> Told<Parts<'a>> {
        let mut blob = blob;
        let mut buffers = Vec::new();
        for buffer in document.buffers() {
            let number = buffer.index();
            let bytes = match buffer.source() {
                buffer::Source::Bin => blob
                    .take()
                    .ok_or("the file has no binary chunk".to_string()),
                buffer::Source::Uri(uri) => resource(path, uri, usize::MAX),
            };
            let bytes = bytes.map_err(|cause| format!("buffers[{number}]: {cause}"))?;
            if bytes.len() < buffer.length() {
                let (has, needed) = (bytes.len(), buffer.length());
                return Err(format!(
                    "buffers[{number}]: {has} bytes, {needed} are needed"
                ));
            }
            buffers.push(bytes);
        }
        Ok(Parts {
            path,
            document,
            buffers,
        })
    }

    pub(super) fn positions(&self, primitive: &Primitive) -> Told<Vec<DVec3>> {
        let name = "POSITION";
        let accessor = primitive
            .get(&Semantic::Positions)
            .ok_or("it has no POSITION")?;
        self.check(&accessor, name, &[DataType::F32], Dimensions::Vec3)?;
        let reader = primitive.reader(|buffer| self.bytes(buffer.index()));
        let positions = reader.read_positions().ok_or("POSITION cannot be read")?;
        Ok(positions
            .map(|at| DVec3::from_array(at.map(f64::from)))
            .collect())
    }

    /// `None` where vertices are taken as they come.
    pub(super) fn indices(&self, primitive: &Primitive) -> Told<Option<Vec<usize>>> {
        let Some(accessor) = primitive.indices() else {
            return Ok(None);
        };
        let kinds = [DataType::U8, DataType::U16, DataType::U32];
        self.check(&accessor, "indices", &kinds, Dimensions::Scalar)?;
        let reader = primitive.reader(|buffer| self.bytes(buffer.index()));
        let indices = reader.read_indices().ok_or("indices cannot be read")?;
        Ok(Some(
            indices.into_u32().map(|index| index as usize).collect(),
        ))
    }

    /// Of each vertex, upwards; `None` where the mesh has none.
    pub(super) fn texture_coordinates(
        &self,
        primitive: &Primitive,
        texture: &Info,
    ) -> Told<Option<Vec<[f32; 2]>>> {
        let transform = texture.texture_transform();
        let set = transform
            .as_ref()
            .and_then(|transform| transform.tex_coord())
            .unwrap_or(texture.tex_coord());
        let Some(accessor) = primitive.get(&Semantic::TexCoords(set)) else {
            return Ok(None);
        };
        let kinds = [DataType::U8, DataType::U16, DataType::F32];
        self.check(
            &accessor,
            &format!("TEXCOORD_{set}"),
            &kinds,
            Dimensions::Vec2,
        )?;
        let reader = primitive.reader(|buffer| self.bytes(buffer.index()));
        let coordinates = reader
            .read_tex_coords(set)
            .ok_or("texture coordinates cannot be read")?;
        let moved = |[u, v]: [f32; 2]| {
            let Some(transform) = &transform else {
                return [u, 1.0 - v];
            };
            let ([right, down], [across, along]) = (transform.offset(), transform.scale());
            let (sine, cosine) = transform.rotation().sin_cos();
            let (u, v) = (u * across, v * along);
            [
                cosine * u + sine * v + right,
                1.0 - (cosine * v - sine * u + down),
            ]
        };
        Ok(Some(coordinates.into_f32().map(moved).collect()))
    }

    /// The texture's image; `None`, with a warning, where it cannot be read.
    pub(super) fn texture(&self, texture: &Info, collector: &mut Collector) -> Option<u32> {
        let Some(image) = texture.texture().source() else {
            let number = texture.texture().index();
            collector.count("a texture without a PNG or JPEG image was left out", || {
                format!("textures[{number}]")
            });
            return None;
        };
        let number = image.index();
        let most = collector.most_image_bytes();
        let image = self.document.as_json().images.get(number)?;
        let embedded = format!("{}: images[{number}]", self.path.display());
        match (&image.uri, &image.buffer_view) {
            (Some(uri), _) => {
                let name = match uri.starts_with("data:") {
                    true => embedded,
                    false => beside(self.path, &plain(uri)).display().to_string(),
                };
                collector.texture(&name, || resource(self.path, uri, most))
            }
            (None, Some(view)) => collector.texture(&embedded, || self.view(view.value())),
            (None, None) => {
                collector.texture(&embedded, || Err("neither a file nor a buffer".to_string()))
            }
        }
    }

    fn bytes(&self, buffer: usize) -> Option<&[u8]> {
        self.buffers.get(buffer).map(Vec::as_slice)
    }

    fn view(&self, number: usize) -> Told<Vec<u8>> {
        let view = self
            .document
            .views()
            .nth(number)
            .ok_or("its buffer view is missing")?;
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| self.bytes(view.buffer().index())?.get(view.offset()..end))
            .map(<[u8]>::to_vec)
            .ok_or_else(|| format!("bufferViews[{number}] is not within its buffer"))
    }

    /// Whether an accessor is of a kind that can be read, and lies within its buffer.
    fn check(
        &self,
        accessor: &Accessor,
        name: &str,
        kinds: &[DataType],
        dimensions: Dimensions,
    ) -> Told<()> {
        let refuse =
            |cause: &str| Err(format!("{name} (accessors[{}]): {cause}", accessor.index()));
        if !kinds.contains(&accessor.data_type()) || accessor.dimensions() != dimensions {
            return refuse("numbers of an unexpected type");
        }
        if accessor.sparse().is_some() {
            return refuse("sparse accessors are not supported");
        }
        let Some(view) = accessor.view() else {
            return refuse("it has no buffer view");
        };
        let size = accessor.size();
        let stride = view.stride().unwrap_or(size);
        if accessor.count() == 0 || stride < size {
            return refuse("it has no numbers, or they overlap");
        }
        let end = stride
            .checked_mul(accessor.count() - 1)
            .and_then(|length| length.checked_add(size)?.checked_add(accessor.offset()));
        let view_end = view.offset().checked_add(view.length());
        let length = self.bytes(view.buffer().index()).map_or(0, <[u8]>::len);
        if end.is_none_or(|end| end > view.length()) || view_end.is_none_or(|end| end > length) {
            return refuse("it reaches beyond its buffer");
        }
        Ok(())
    }
}

/// The bytes that an address stands for: within itself, or in a file beside `path`.
fn resource(path: &Path, uri: &str, most: usize) -> Told<Vec<u8>> {
    let Some(data) = uri.strip_prefix("data:") else {
        let file = beside(path, &plain(uri));
        return bytes_beside(&file, most).map_err(|cause| format!("{}: {cause}", file.display()));
    };
    let (_, text) = data
        .split_once(";base64,")
        .ok_or("data that is not base64")?;
    let lenient =
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    GeneralPurpose::new(&alphabet::STANDARD, lenient)
        .decode(text)
        .map_err(|error| format!("data that is not base64: {error}"))
}

/// An address with `%20` and the like as the characters that they stand for.
fn plain(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut plain = Vec::with_capacity(bytes.len());
    let mut place = 0;
    while let Some(&byte) = bytes.get(place) {
        let code = bytes
            .get(place + 1..place + 3)
            .filter(|_| byte == b'%')
            .and_then(|digits| std::str::from_utf8(digits).ok())
            .and_then(|digits| u8::from_str_radix(digits, 16).ok());
        plain.push(code.unwrap_or(byte));
        place += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&plain).into_owned()
}

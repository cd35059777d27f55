//! Every kind of image that a texture may come as.

use jpeg_encoder::{ColorType as JpegColour, Encoder as JpegEncoder};
use kimberlite::blockmap::Scene;
use kimberlite::blockmap::source::{SourceOptions, read};
use png::{BitDepth, ColorType};

use super::{Folder, assert_warned};

fn with_image(image: &[u8], options: &SourceOptions) -> Scene {
    let folder = Folder::new();
    folder.write("image", image);
    folder.write("m.mtl", "newmtl m\nmap_Kd image\n");
    let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
    read(&[folder.write("city.obj", text)], options).unwrap()
}

fn png_of(colour: ColorType, depth: BitDepth) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 6, 4);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == ColorType::Indexed {
        encoder.set_palette(vec![1, 2, 3, 4, 5, 6]);
    }
    let bits = 6 * colour.samples() * depth as usize;
    let mut writer = encoder.write_header().unwrap();
    writer
        .write_image_data(&vec![0; bits.div_ceil(8) * 4])
        .unwrap();
    writer.finish().unwrap();
    bytes
}

fn jpeg_of(colour: JpegColour, bands: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new(&mut bytes, 90)
        .encode(&vec![100; 24 * bands], 6, 4, colour)
        .unwrap();
    bytes
}

#[test]
fn grey_palette_alpha_and_deep_images_are_textures() {
    let images = [
        png_of(ColorType::Rgb, BitDepth::Eight),
        png_of(ColorType::Rgb, BitDepth::Sixteen),
        png_of(ColorType::Rgba, BitDepth::Eight),
        png_of(ColorType::Grayscale, BitDepth::One),
        png_of(ColorType::Grayscale, BitDepth::Sixteen),
        png_of(ColorType::GrayscaleAlpha, BitDepth::Eight),
        png_of(ColorType::Indexed, BitDepth::One),
        jpeg_of(JpegColour::Rgb, 3),
        jpeg_of(JpegColour::Luma, 1),
    ];
    for (number, image) in images.iter().enumerate() {
        let scene = with_image(image, &SourceOptions::default());
        assert_eq!(scene.warnings, [""; 0], "image {number}");
        assert_eq!(scene.textures[0].bytes(), 72, "image {number}");
    }
}

#[test]
fn an_image_that_cannot_be_used_is_left_out_with_its_cause() {
    let whole = png_of(ColorType::Rgb, BitDepth::Eight);
    let few = SourceOptions {
        max_texture_bytes: 71,
        ..SourceOptions::default()
    };
    let cases = [
        (whole[..40].to_vec(), SourceOptions::default(), "left out"),
        (
            jpeg_of(JpegColour::Rgb, 3)[..200].to_vec(),
            SourceOptions::default(),
            "left out",
        ),
        (
            jpeg_of(JpegColour::Cmyk, 4),
            SourceOptions::default(),
            "not supported",
        ),
        (
            b"GIF89a".to_vec(),
            SourceOptions::default(),
            "neither a PNG nor a JPEG",
        ),
        (whole, few, "71"),
    ];
    for (image, options, cause) in cases {
        let scene = with_image(&image, &options);
        assert!(scene.textures.is_empty(), "{cause}");
        assert_eq!(scene.warnings.len(), 1);
        assert_warned(&scene, &["image", cause]);
    }
}

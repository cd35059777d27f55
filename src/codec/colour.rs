//! Colours as one luma and two chroma components: the reversible YCoCg-R of Malvar and Sullivan
//! ("YCoCg-R: A Color Space with RGB Reversibility and Low Dynamic Range", JVT-I014r3, 2003).
//!
//! With M the greatest sample, Y lies in 0..=M, and Co and Cg in -M..=M.

/// Y, Co and Cg of red, green and blue; exact, and reversed by [`from_components`].
pub fn to_components([red, green, blue]: [i32; 3]) -> [i32; 3] {
    let orange = red - blue;
    let middle = blue + (orange >> 1);
    let green_chroma = green - middle;
    [middle + (green_chroma >> 1), orange, green_chroma]
}

/// Red, green and blue of Y, Co and Cg, clamped to 0..=`greatest`, from components within
/// [`component_ranges`].
pub fn from_components([luma, orange, green_chroma]: [i32; 3], greatest: i32) -> [i32; 3] {
    let middle = luma - (green_chroma >> 1);
    let blue = middle - (orange >> 1);
    [blue + orange, green_chroma + middle, blue].map(|number| number.clamp(0, greatest))
}

/// Least and greatest Y, Co and Cg of colours within 0..=`greatest`.
pub fn component_ranges(greatest: i32) -> [[i32; 2]; 3] {
    [[0, greatest], [-greatest, greatest], [-greatest, greatest]]
}

/// The largest error of red, green and blue that components decoded within `bounds` of theirs, and
/// clamped to their ranges, can lead to.
///
/// For an integer n and an error d with |d| <= b, floor((n + d) / 2) and ceil((n + d) / 2) are off by at most
/// ceil(b / 2). The inverse is G = Y + ceil(Cg / 2), B = Y - floor(Cg / 2) - floor(Co / 2) and
/// R = Y - floor(Cg / 2) + ceil(Co / 2), so that R and B are off by at most
/// e_Y + ceil(e_Co / 2) + ceil(e_Cg / 2), and some colours are; G is off by less. Clamping to a range
/// that contains the true value never adds to an error.
pub fn colour_error(bounds: [i32; 3]) -> i32 {
    bounds[0] + (bounds[1] + 1) / 2 + (bounds[2] + 1) / 2
}

/// Bounds for Y, Co and Cg that keep red, green and blue within `max_error` (0 or more) of theirs, and
/// use all of it: [`colour_error`] of them is `max_error`.
///
/// Chroma bounds are even, since an odd one costs as much error as the next even one. Of all
/// splits E = e_Y + e_Co / 2 + e_Cg / 2, three fifths for luma came out best, or within some percent of
/// the best in bits, over images from noisy to smooth; the split for independent, widely spread
/// components, e_Y = E / 3, was best on the noisy one alone and cost up to twice as much on the others,
/// whose chroma is soon all zeros.
pub fn component_bounds(max_error: i32) -> [i32; 3] {
    let luma = (i64::from(max_error) * 3 / 5) as i32;
    let chroma = max_error - luma;
    let orange = (chroma + 1) / 2;
    [luma, 2 * orange, 2 * (chroma - orange)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn colours(range: std::ops::RangeInclusive<i32>) -> impl Iterator<Item = [i32; 3]> {
        let each = move || range.clone();
        let all = each().flat_map({
            let each = each.clone();
            move |red| each().map(move |green| [red, green])
        });
        all.flat_map(move |[red, green]| each().map(move |blue| [red, green, blue]))
    }

    fn largest_error(colour: [i32; 3], other: [i32; 3]) -> i32 {
        let errors = colour.iter().zip(other).map(|(a, b)| (a - b).abs());
        errors.max().unwrap()
    }

    /// Components off by some error each, clamped to their ranges as a decoder does.
    fn off_by(components: [i32; 3], errors: [i32; 3], greatest: i32) -> [i32; 3] {
        let ranges = component_ranges(greatest);
        [0, 1, 2].map(|i| (components[i] + errors[i]).clamp(ranges[i][0], ranges[i][1]))
    }

    fn errors_within([luma, orange, green]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
        (-luma..=luma).flat_map(move |a| {
            (-orange..=orange).flat_map(move |b| (-green..=green).map(move |c| [a, b, c]))
        })
    }

    #[test]
    fn all_colours_of_8_bits_come_back_from_components_within_their_ranges() {
        let (mut least, mut most) = ([i32::MAX; 3], [i32::MIN; 3]);
        for colour in colours(0..=255) {
            let components = to_components(colour);
            assert_eq!(from_components(components, 255), colour);
            for i in 0..3 {
                least[i] = least[i].min(components[i]);
                most[i] = most[i].max(components[i]);
            }
        }
        assert_eq!(
            [0, 1, 2].map(|i| [least[i], most[i]]),
            component_ranges(255)
        );
    }

    #[test]
    fn error_of_colours_is_the_largest_that_bounds_allow_and_no_more() {
        for bounds in colours(0..=4) {
            let decoded = |colour: [i32; 3], greatest| {
                let components = to_components(colour);
                let worst = errors_within(bounds).map(|errors| {
                    let off = off_by(components, errors, greatest);
                    largest_error(colour, from_components(off, greatest))
                });
                worst.max().unwrap()
            };
            let unclamped = colours(30..=33).map(|colour| decoded(colour, 64)).max();
            assert_eq!(unclamped, Some(colour_error(bounds)), "{bounds:?}");
            let clamped = colours(0..=3).map(|colour| decoded(colour, 3)).max();
            assert!(clamped <= Some(colour_error(bounds)), "{bounds:?}");
        }
    }

    #[test]
    fn bounds_of_components_use_all_of_the_error() {
        for max_error in (0..2000).chain([65535, 1 << 20, (1 << 30) - 1]) {
            let bounds = component_bounds(max_error);
            assert_eq!(colour_error(bounds), max_error);
            assert!(bounds.iter().all(|&bound| bound >= 0));
        }
        assert_eq!(component_bounds(0), [0, 0, 0]);
    }

    proptest! {
        #[test]
        fn colours_of_16_bits_come_back(colour in prop::array::uniform3(0..=65535i32)) {
            let components = to_components(colour);
            prop_assert_eq!(from_components(components, 65535), colour);
            for (component, [low, high]) in components.into_iter().zip(component_ranges(65535)) {
                prop_assert!((low..=high).contains(&component));
            }
        }

        #[test]
        fn quantised_components_of_16_bits_keep_colours_within_the_error(
            colour in prop::array::uniform3(prop_oneof![0..=65535i32, 0..=20i32, 65500..=65535i32]),
            prediction in prop::array::uniform3(-65535..=65535i32),
            max_error in prop_oneof![0..20i32, 0..70000i32],
        ) {
            let components = to_components(colour);
            let bounds = component_bounds(max_error);
            let ranges = component_ranges(65535);
            let decoded = [0, 1, 2].map(|i| {
                let step = 2 * bounds[i] + 1;
                let coefficient = (components[i] - prediction[i] + bounds[i]).div_euclid(step);
                (prediction[i] + coefficient * step).clamp(ranges[i][0], ranges[i][1])
            });
            prop_assert!(largest_error(colour, from_components(decoded, 65535)) <= max_error);
        }
    }
}

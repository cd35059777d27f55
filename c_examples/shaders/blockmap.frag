#version 150
// A ray through a BlockMap: a grid of prisms that reach down to the floor of the city. It goes from texel to texel, by the same rules as the
// library's own rays (kmb_city_visit_cast), and meets the side of a prism or its top.
//
// x and y are in texels of the block, from its south-west corner; z is in the city's unit. The view is a perspective one. Distances along a
// ray are those of its pixel in clip space: w.

// (2 K + 256) x K texels of GL_RGBA8UI, row 0 in the south: heights, wall columns and normals of roofs; roofs; walls.
uniform usampler2D image;
// K x K texels of GL_R8UI, the low bytes of the heights, where these have 16 bits.
uniform usampler2D low_heights;
uniform bool has_16_bits;
// Texels along the block, K.
uniform int side;
// Of the walls.
uniform int slices;
// Of the lowest and the highest code.
uniform vec2 heights;
// A wall begins above a step that is higher than this.
uniform float steepest_step;
// Down to where all prisms reach.
uniform float city_floor;
// The square of the block that is drawn: the block, or one of its quarters.
uniform vec2 low;
uniform vec2 high;
// Length of a texel.
uniform float texel_size;
// The eye, and the direction of a pixel's ray: direction_from_pixel * (x, y, 1), with x and y from 0 at the picture's lower left corner.
uniform vec3 eye;
uniform mat3 direction_from_pixel;
// The depth in clip space at a distance: dot(depth_row, direction) * distance + depth_at_eye.
uniform vec3 depth_row;
uniform float depth_at_eye;
// Whether ambient occlusion darkens the picture.
uniform bool has_occlusion;

out vec4 colour;

const vec3 LIGHT = vec3(0.45, -0.35, 0.82);
// Share of the light that comes from all around.
const float AMBIENT = 0.45;

// Where a ray meets the block.
struct Hit {
    float distance;
    ivec2 texel;
    float height;
    bool is_wall;
};

// From where to where the ray is in the box of what is drawn, and whether it comes in through a side; nothing is met where start > end.
void enter(vec3 direction, out float start, out float end, out bool from_side)
{
    vec3 least = vec3(low, city_floor);
    vec3 most = vec3(high, max(heights.y, city_floor));
    start = 0.0;
    end = 3.0e38;
    from_side = false;
    for (int axis = 0; axis < 3; axis++) {
        if (direction[axis] == 0.0) {
            if (eye[axis] < least[axis] || eye[axis] > most[axis]) end = -1.0;
            continue;
        }
        float one = (least[axis] - eye[axis]) / direction[axis];
        float other = (most[axis] - eye[axis]) / direction[axis];
        if (min(one, other) > start) {
            start = min(one, other);
            from_side = axis < 2;
        }
        end = min(end, max(one, other));
    }
}

// A texel of the walk is one of the image, counted from the other end where the ray runs against its axis.
ivec2 unmirrored(ivec2 texel, bvec2 is_mirrored)
{
    return ivec2(is_mirrored.x ? side - 1 - texel.x : texel.x, is_mirrored.y ? side - 1 - texel.y : texel.y);
}

float top_of(ivec2 texel)
{
    uint code = texelFetch(image, texel, 0).r;
    if (!has_16_bits) return heights.x + float(code) / 255.0 * (heights.y - heights.x);
    code = 256u * code + texelFetch(low_heights, texel, 0).r;
    return heights.x + float(code) / 65535.0 * (heights.y - heights.x);
}

bool has_wall(ivec2 texel)
{
    return texelFetch(image, texel, 0).g != 0u;
}

// A line between texels is crossed at (line - origin) * inverse. Of two lines at the same distance that of x comes first.
bool walk(vec3 direction, out Hit hit)
{
    float start, end;
    bool from_side;
    enter(direction, start, end, from_side);
    if (start > end) return false;
    vec3 place = eye + start * direction;
    bvec2 is_mirrored = lessThan(direction.xy, vec2(0.0));
    vec2 origin = clamp(mix(place.xy, float(side) - place.xy, vec2(is_mirrored)), 0.0, float(side));
    vec2 forward = abs(direction.xy);
    vec2 inverse = 1.0 / max(forward, 1.0e-30);
    float last = end - start;
    ivec2 texel = min(ivec2(origin), ivec2(side - 1));
    float near = 0.0;
    float top_before = 0.0;
    // The step at the edge where the ray came in is that of the block's border.
    bool is_first = true;
    for (int count = 0; count < 2 * side; count++) {
        vec2 crossings = mix(vec2(3.0e38), (vec2(texel + 1) - origin) * inverse, greaterThan(forward, vec2(0.0)));
        float leave = min(min(crossings.x, crossings.y), last);
        ivec2 found = unmirrored(texel, is_mirrored);
        float top = top_of(found);
        float height = place.z + near * direction.z;
        if (height <= top) {
            bool is_steep = is_first ? from_side : top - top_before > steepest_step;
            hit = Hit(start + near, found, height, is_steep && has_wall(found));
            return true;
        }
        if (place.z + leave * direction.z <= top) {
            float distance = clamp((top - place.z) / direction.z, near, leave);
            hit = Hit(start + distance, found, top, false);
            return true;
        }
        if (leave >= last) return false;
        if (crossings.x > crossings.y) texel.y++;
        else texel.x++;
        if (max(texel.x, texel.y) >= side) return false;
        near = leave;
        top_before = top;
        is_first = false;
    }
    return false;
}

vec3 unpacked(uvec3 bytes)
{
    return (vec3(bytes) - 127.0) / 127.0;
}

// Colour and occlusion, and a normal, of what is there.
uvec4 surface(Hit hit, out vec3 normal)
{
    uvec4 shape = texelFetch(image, hit.texel, 0);
    if (!hit.is_wall) {
        vec2 across = unpacked(uvec3(shape.ba, 127u)).xy;
        normal = vec3(across, sqrt(max(1.0 - dot(across, across), 0.0)));
        return texelFetch(image, hit.texel + ivec2(side, 0), 0);
    }
    int rows = side / slices;
    int first = hit.texel.y / rows * rows;
    int column = 2 * side + int(shape.g);
    float share = heights.y > heights.x ? (hit.height - heights.x) / (heights.y - heights.x) : 0.0;
    int above = min(int(max(share * float(rows - 1), 0.0)), rows - 2);
    normal = unpacked(texelFetch(image, ivec2(column, first + rows - 1), 0).rgb);
    return texelFetch(image, ivec2(column, first + above), 0);
}

void main()
{
    vec3 direction = direction_from_pixel * vec3(gl_FragCoord.xy, 1.0);
    Hit hit;
    if (!walk(direction, hit)) discard;
    vec3 normal;
    uvec4 found = surface(hit, normal);
    // Both sides are lit alike.
    if (dot(normal, direction * vec3(texel_size, texel_size, 1.0)) > 0.0) normal = -normal;
    float occlusion = has_occlusion ? float(found.a) / 255.0 : 1.0;
    float share = AMBIENT * occlusion + (1.0 - AMBIENT) * max(dot(normal, LIGHT), 0.0);
    colour = vec4(min(floor(vec3(found.rgb) * share + 0.5), 255.0) / 255.0, 1.0);
    gl_FragDepth = 0.5 + 0.5 * (dot(depth_row, direction) + depth_at_eye / hit.distance);
}

#version 150
// A box around what is drawn of a block: from the floor of the city to the highest prism. Only its back faces are drawn, so that each
// pixel comes once, and also while the eye is inside. Depths must be clamped, not clipped (GL_DEPTH_CLAMP): the box may reach beyond
// the far plane where the prisms do not.

// Each coordinate is 0 or 1.
in vec3 corner;

// Computed in doubles, box by box: the coordinates of a city are too large for floats. The box is a little larger than what is drawn,
// since it is only where the rays are looked for.
uniform mat4 clip_from_box;

void main()
{
    gl_Position = clip_from_box * vec4(corner, 1.0);
}

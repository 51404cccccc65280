"""The graphics programs of renderer.py, GLSL 3.30. Lengths in m, robot frame, unless said otherwise."""

LENS = """#version 330
uniform mat4 camera;           // from the robot frame to the rectified camera
uniform mat3 rectification;    // from the rectified camera to the lens
uniform vec4 lens;             // fx, fy, cx, cy
uniform vec3 radial;           // k1, k2, k3
uniform vec2 tangential;       // p1, p2
uniform vec2 picture_size;
uniform float fold, near;
uniform vec4 place;            // x, y, cos and sin of the yaw
uniform float scale;

vec3 placed(vec3 position) {
    vec3 p = position * scale;
    return vec3(place.x + place.z * p.x - place.w * p.y, place.y + place.w * p.x + place.z * p.y, p.z);
}

vec4 projected(vec3 point) {   // plumb_bob; beyond the fold straight on, out of the picture
    vec3 ray = rectification * (camera * vec4(point, 1.0)).xyz;
    vec2 n = ray.xy / max(ray.z, near);
    float r2 = dot(n, n);
    float q = min(r2, fold);
    float bent = 1.0 + q * (radial.x + q * (radial.y + q * radial.z));
    vec2 m = n * bent;
    if (r2 <= fold)
        m += vec2(2.0 * tangential.x * n.x * n.y + tangential.y * (r2 + 2.0 * n.x * n.x),
                  tangential.x * (r2 + 2.0 * n.y * n.y) + 2.0 * tangential.y * n.x * n.y);
    vec2 pixel = m * lens.xy + lens.zw;
    vec2 device = 2.0 * (pixel + 0.5) / picture_size - 1.0;
    float depth = 0.9 * (1.0 - 2.0 * near / max(ray.z, near));
    return ray.z < near ? vec4(0.0, 0.0, 2.0, 1.0) : vec4(device, depth, 1.0) * ray.z;
}
"""

THING = """
uniform vec3 lamps[3];         // towards the lamps, in the thing's own frame
uniform vec3 shares, factor, eye;
uniform float ambient;
in vec3 position, normal, albedo;
in float gloss;
out vec3 radiance;

void main() {
    vec3 to_eye = normalize(eye - position);
    float diffuse = ambient * (0.62 + 0.38 * normal.z) * (0.65 + 0.35 * smoothstep(0.0, 0.35, position.z));
    float mirrored = 0.0;
    for (int i = 0; i < 3; i++) {
        diffuse += shares[i] * max(dot(normal, lamps[i]), 0.0);
        mirrored += shares[i] * pow(max(dot(normal, normalize(lamps[i] + to_eye)), 0.0), 50.0);
    }
    radiance = factor * (albedo * diffuse + vec3(0.8 * gloss * mirrored));
    gl_Position = projected(placed(position));
}
"""

COLOR = """#version 330
uniform vec2 picture_size;
uniform vec3 vignette;
in vec3 radiance;
out vec4 color;
void main() {                  // alpha 0: nothing of the backdrop is seen
    vec2 middle = gl_FragCoord.xy / picture_size - 0.5;
    color = vec4(sqrt(radiance * (1.0 - vignette * dot(middle, middle))), 0.0);
}
"""

SHADOW = """
uniform vec3 lamp;             // towards the lamp
uniform float layer;
in vec3 position;
void main() {
    vec3 p = placed(position);
    gl_Position = projected(vec3(p.xy - lamp.xy * p.z / lamp.z, 0.0));
    if (gl_Position.z < gl_Position.w)  // what lies behind the camera stays out of the picture
        gl_Position.z = layer * gl_Position.w;
}
"""

NAME = """
in vec3 position;
void main() { gl_Position = projected(placed(position)); }
"""

FLAT = """#version 330
uniform vec4 factor;
out vec4 color;
void main() { color = factor; }
"""

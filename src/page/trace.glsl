precision highp float;
precision highp int;
precision highp usampler2D;

// Rays through an octree, one a fragment: the walk of model.js in 32 bits.

const int MAX_STEPS = 4096;
const int WIDTH_BITS = 12;

uniform usampler2D nodes, normals, offsets, cornerBits, corners, colors, leafBits, leafNormals, leafOffsets;
uniform uint nodeCount;
uniform int depth;
/** Are normals blended between the boxes around a hit? */
uniform bool isSmooth;
uniform bool hasNormals, hasCorners, hasLeaves, isCells, hasColors, isFlat;
/** Ray of the picture point (x, y): a constant, its change with x, and with y; in the grid. */
uniform vec3 origin[3], direction[3];
/** The stored normal to the camera's frame: right, up, to the eye. */
uniform mat3 normalToCamera;
/** What is behind the plane n . p = w of the grid is cut away, unless n is 0. */
uniform vec4 cut;
uniform vec3 cutNormal;
uniform vec2 size, jitter, corner;
uniform vec3 surfaceColor;
uniform vec4 background[2];
uniform float weight;
uniform int mode;
#ifdef LABELS
uniform usampler2D labels, labelColors;
/** Labels that are seen, as bits by their places in the table from 1 on. */
uniform uint eyes[8];
#endif

struct Hit { float t; uint box; vec3 normal; int level; uint label; bool isWithin; };

uvec4 texel(usampler2D from, uint at) {
    return texelFetch(from, ivec2(int(at & ((1u << WIDTH_BITS) - 1u)), int(at >> WIDTH_BITS)), 0);
}

uint ones(uint word) {
    word -= word >> 1 & 0x55555555u;
    word = (word & 0x33333333u) + (word >> 2 & 0x33333333u);
    return (word + (word >> 4) & 0x0f0f0f0fu) * 0x01010101u >> 24;
}

/** What is behind a bit of 96: how many are set before it, and is it set? */
bool rank(uvec4 bits, uint bit, out uint number) {
    uint word = bit >> 5, shift = bit & 31u;
    uint here = word == 0u ? bits.x : word == 1u ? bits.y : bits.z;
    number = bits.w + ones(here & (1u << shift) - 1u);
    if (word > 0u) number += ones(bits.x);
    if (word > 1u) number += ones(bits.y);
    return (here >> shift & 1u) == 1u;
}

uint byteOf(usampler2D from, uint at) {
    uvec4 bytes = texel(from, at >> 4);
    uint word = at >> 2 & 3u;
    uint here = word == 0u ? bytes.x : word == 1u ? bytes.y : word == 2u ? bytes.z : bytes.w;
    return here >> 8u * (at & 3u) & 255u;
}

float signedByte(uint byte) { return float(int(byte << 24) >> 24); }

vec3 octahedral(vec2 q, float one) {
    float z = one - abs(q.x) - abs(q.y);
    if (z >= 0.0) return vec3(q, z);
    return vec3((q.x < 0.0 ? -1.0 : 1.0) * (one - abs(q.y)), (q.y < 0.0 ? -1.0 : 1.0) * (one - abs(q.x)), z);
}

vec2 code(usampler2D from, uint at) { return vec2(signedByte(byteOf(from, 2u * at)), signedByte(byteOf(from, 2u * at + 1u))); }

/** The normal of a voxel or cell. */
vec3 normalOf(uint at) {
    return octahedral(code(normals, at), 127.0);
}

float trilinear(vec4 low, vec4 high, vec3 w) {
    vec2 x0 = mix(vec2(low.x, low.z), vec2(low.y, low.w), w.x), x1 = mix(vec2(high.x, high.z), vec2(high.y, high.w), w.x);
    return mix(mix(x0.x, x0.y, w.y), mix(x1.x, x1.y, w.y), w.z);
}

vec3 gradientOf(vec4 low, vec4 high, vec3 w) {
    vec4 z = mix(low, high, w.z);
    vec2 y = mix(z.xy, z.zw, w.y), x = mix(vec2(z.x, z.z), vec2(z.y, z.w), w.x);
    return vec3(y.y - y.x, x.y - x.x, trilinear(high, high, w) - trilinear(low, low, w));
}

/** Where trilinear values along a line are 0 or more first, 0..1; -1 where they are nowhere. */
float firstRoot(vec4 low, vec4 high, vec3 from, vec3 to) {
    vec4 f = vec4(trilinear(low, high, from), trilinear(low, high, mix(from, to, 1.0 / 3.0)),
        trilinear(low, high, mix(from, to, 2.0 / 3.0)), trilinear(low, high, to));
    if (f.x >= 0.0) return 0.0;
    float third = 4.5 * (f.w - 3.0 * f.z + 3.0 * f.y - f.x);
    float second = 4.5 * (f.z - 2.0 * f.y + f.x) - third;
    float first = 3.0 * (f.y - f.x) - second / 3.0 - third / 9.0;
    vec2 turns;
    if (abs(third) < 1e-5 * abs(second)) {
        turns = vec2(-first / (2.0 * second));
    } else {
        float root = sqrt(max(0.0, second * second - 3.0 * third * first));
        turns = vec2(-second - root, -second + root) / (3.0 * third);
        if (turns.x > turns.y) turns = turns.yx;
    }
    float begin = 0.0;
    for (int i = 0; i < 3; i++) {
        float stop = i == 0 ? turns.x : i == 1 ? turns.y : 1.0;
        if (stop > begin && stop <= 1.0) {
            if (trilinear(low, high, mix(from, to, stop)) >= 0.0) {
                for (int k = 0; k < 22; k++) {
                    float middle = 0.5 * (begin + stop);
                    if (trilinear(low, high, mix(from, to, middle)) >= 0.0) stop = middle;
                    else begin = middle;
                }
                return stop;
            }
            begin = stop;
        }
    }
    return -1.0;
}

#ifdef LABELS
uint seen(uint label) { return (eyes[label >> 5] >> (label & 31u) & 1u) == 1u ? label : 0u; }

uint part(uvec2 labels, int i) { return labels[i >> 2] >> 8 * (i & 3) & 255u; }

/** The walls between the labels of a cell: meetWalls of model.js. */
bool meetWalls(uint cell, vec3 from, vec3 to, out float s, out vec3 normal, out uint label) {
    vec3 n[3];
    vec3 k = vec3(signedByte(byteOf(offsets, cell)), 0, 0), first, last, at = vec3(2);
    uvec2 parts = uvec2(byteOf(labels, 2u * cell) | byteOf(labels, 2u * cell + 1u) << 8, 0);
    int count = 1, fronts = 0;
    uint number;
    n[0] = n[1] = n[2] = normal = normalOf(cell);
    if (k.x != -128.0) {
        k.x = 2.0 * floor(0.5 * k.x);
    } else if (hasCorners && rank(texel(cornerBits, cell / 96u), cell % 96u, number)) {
        uvec4 item = texel(corners, number);
        parts = item.xy;
        k = vec3(signedByte(item.z), signedByte(item.z >> 8), 0);
        count = k.x == -128.0 ? 3 : 2;
        if (count == 3) {
            n = vec3[3](vec3(127, 0, 0), vec3(0, 127, 0), vec3(0, 0, 127));
            k = vec3(0);
        } else {
            n[1] = octahedral(vec2(signedByte(item.z >> 16), signedByte(item.z >> 24)), 127.0);
            uvec4 by = uvec4(0);
            for (int i = 0; i < 8; i++) {
                vec3 u = vec3(i & 1, i >> 1 & 1, i >> 2) * 2.0 - 1.0;
                by[dot(n[0], u) > k.x ? (dot(n[1], u) > k.y ? 3 : 1) : 0] = part(item.xy, i);
            }
            parts = uvec2(by.x | by.y << 8 | by.x << 16 | by.w << 24, 0);
        }
    }
    for (int i = 0; i < count; i++) {
        first[i] = dot(n[i], from) - k[i];
        last[i] = dot(n[i], to) - k[i];
        if (first[i] > 0.0) fronts |= 1 << i;
        if (first[i] > 0.0 != last[i] > 0.0) at[i] = first[i] / (first[i] - last[i]);
    }
    s = 0.0;
    label = seen(part(parts, fronts));
    if (label > 0u) {
        float least = 1e9;
        for (int i = 0; i < count; i++) {
            float far = abs(first[i]) * inversesqrt(dot(n[i], n[i]));
            if (far < least && seen(part(parts, fronts ^ 1 << i)) != label) {
                least = far;
                normal = (fronts >> i & 1) == 1 ? -n[i] : n[i];
            }
        }
        return true;
    }
    for (int turn = 0; turn < 3; turn++) {
        int i = at.x <= at.y ? (at.x <= at.z ? 0 : 2) : (at.y <= at.z ? 1 : 2);
        s = at[i];
        if (s > 1.5) return false;
        at[i] = 2.0;
        fronts ^= 1 << i;
        label = seen(part(parts, fronts));
        normal = (fronts >> i & 1) == 1 ? -n[i] : n[i];
        if (label > 0u) return true;
    }
    return false;
}
#endif

/** The surface within a box from `enter` to `leave`; the place in it is u, -1 to 1, as stored. */
bool meet(uint box, bool isLeaf, vec3 from, vec3 to, out float s, out vec3 normal, out uint label) {
    s = 0.0;
    label = 0u;
    if (!isCells) {
        normal = hasNormals ? normalOf(box - nodeCount) : vec3(0);
        return true;
    }
    uint number = box - nodeCount;
#ifdef LABELS
    return meetWalls(number, from, to, s, normal, label);
#endif
    float offset;
    if (isLeaf) {
        rank(texel(leafBits, box / 96u), box % 96u, number);
        normal = octahedral(code(leafNormals, number), 127.0);
        offset = signedByte(byteOf(leafOffsets, number));
    } else {
        normal = normalOf(number);
        offset = signedByte(byteOf(offsets, number));
        uint at;
        if (hasCorners && offset == -128.0 && rank(texel(cornerBits, number / 96u), number % 96u, at)) {
            uvec4 both = texel(corners, at >> 1);
            uvec2 bytes = (at & 1u) == 0u ? both.xy : both.zw;
            vec4 low = vec4(signedByte(bytes.x), signedByte(bytes.x >> 8), signedByte(bytes.x >> 16), signedByte(bytes.x >> 24));
            vec4 high = vec4(signedByte(bytes.y), signedByte(bytes.y >> 8), signedByte(bytes.y >> 16), signedByte(bytes.y >> 24));
            from = 0.5 + 0.5 * from;
            to = 0.5 + 0.5 * to;
            s = firstRoot(low, high, from, to);
            vec3 slope = -gradientOf(low, high, mix(from, to, max(s, 0.0)));
            if (dot(slope, normal) < 0.5 * length(slope) * length(normal)) normal = slope;
            return s >= 0.0;
        }
    }
    float first = dot(normal, from) - offset, last = dot(normal, to) - offset;
    if (first <= 0.0) return true;
    s = first / (first - last);
    return last <= 0.0;
}

/** The first box that a ray meets from `t` on. */
bool trace(vec3 o, vec3 d, float t, out Hit hit) {
    float side = float(1 << depth);
    ivec3 flip = ivec3(lessThan(d, vec3(0)));
    o = mix(o, side - o, vec3(flip));
    d = abs(d);
    vec3 inv = 1.0 / max(d, vec3(1e-30));
    vec3 enters = -o * inv, leaves = (side - o) * inv;
    t = max(t, max(enters.x, max(enters.y, enters.z)));
    hit = Hit(t, 0u, vec3(0), 0, 0u, isCells);
    if (!(t < min(leaves.x, min(leaves.y, leaves.z)))) return false;
    uint parents[17];
    int level = depth - 1;
    parents[depth] = 0u;
    ivec3 low = ivec3(lessThan((vec3(1 << level) - o) * inv, vec3(t))) << level;
    vec3 turn = 1.0 - 2.0 * vec3(flip);
    for (int step = 0; step < MAX_STEPS; step++) {
        int edge = 1 << level;
        vec3 next = (vec3(low + edge) - o) * inv;
        uint node = parents[level + 1], child;
        ivec3 bits = (low >> level & 1) ^ flip;
        uint octant = uint(bits.x | bits.y << 1 | bits.z << 2);
        if (rank(texel(nodes, node / 12u), node % 12u * 8u + octant, child)) {
            bool isLeaf = false;
            if (hasLeaves && level > 0) {
                uint number;
                isLeaf = rank(texel(leafBits, child / 96u), child % 96u, number);
            }
            if (level > 0 && !isLeaf) {
                parents[level] = child;
                level--;
                low += ivec3(lessThan((vec3(low + (1 << level)) - o) * inv, vec3(t))) << level;
                continue;
            }
            float leave = min(next.x, min(next.y, next.z)), s;
            vec3 from = clamp(2.0 * (o + d * t - vec3(low)) / float(edge) - 1.0, -1.0, 1.0) * turn;
            vec3 to = clamp(2.0 * (o + d * leave - vec3(low)) / float(edge) - 1.0, -1.0, 1.0) * turn;
            if (meet(child, isLeaf, from, to, s, hit.normal, hit.label)) {
                hit.t = t + (leave - t) * s;
                hit.box = child;
                hit.level = level;
                hit.isWithin = hit.isWithin && s == 0.0;
                return true;
            }
            hit.isWithin = false;
        }
        int axis = next.x <= next.y ? (next.x <= next.z ? 0 : 2) : (next.y <= next.z ? 1 : 2);
        t = next[axis];
        int before = low[axis];
        low[axis] += edge;
        int changed = before ^ low[axis];
        level = 0;
        for (int half_ = 16; half_ > 0; half_ >>= 1) {
            if (changed >> half_ != 0) {
                changed >>= half_;
                level += half_;
            }
        }
        if (level >= depth) return false;
        low = low >> level << level;
    }
    return false;
}

/** The unit normal stored at a place of the grid; 0 where there is none. */
vec3 normalAt(ivec3 place) {
    if (any(lessThan(place, ivec3(0))) || any(greaterThanEqual(place, ivec3(1 << depth)))) return vec3(0);
    uint node = 0u, number;
    for (int level = depth - 1; level >= 0; level--) {
        ivec3 bits = place >> level & 1;
        uint octant = uint(bits.x | bits.y << 1 | bits.z << 2), child;
        if (!rank(texel(nodes, node / 12u), node % 12u * 8u + octant, child)) return vec3(0);
        node = child;
        if (hasLeaves && level > 0 && rank(texel(leafBits, child / 96u), child % 96u, number)) {
            return normalize(octahedral(code(leafNormals, number), 127.0));
        }
    }
    return normalize(normalOf(node - nodeCount));
}

/** The mean of the normals around a point that look about the same way: smooth where the surface is, sharp at its edges. */
vec3 blended(vec3 at, vec3 normal) {
    vec3 n = normalize(normal), sum = vec3(0);
    ivec3 low = ivec3(floor(at - 0.5));
    for (int i = 0; i < 8; i++) {
        ivec3 place = low + ivec3(i & 1, i >> 1 & 1, i >> 2);
        vec3 other = normalAt(place), part = 1.0 - abs(at - vec3(place) - 0.5);
#ifdef LABELS
        // A wall has one of its two sides' normals.
        if (isCells && dot(other, n) < 0.0) other = -other;
#endif
        float alike = clamp((dot(other, n) - 0.3) / 0.5, 0.0, 1.0);
        sum += other * (part.x * part.y * part.z * alike * alike * (3.0 - 2.0 * alike));
    }
    return dot(sum, n) > 0.0 ? sum : n;
}

#ifdef NUMBERS
layout(location = 0) out uvec4 found;
#else
layout(location = 0) out vec4 found;
#endif

vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 encoded(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }

/** A lamp over the left shoulder, one at the eye, and the sky. */
vec3 lit(vec3 surface, vec3 n) {
    if (n.z < 0.0) n = -n;
    float k = max(0.0, dot(n, normalize(vec3(-0.45, 0.55, 0.70))));
    float h = max(0.0, dot(n, normalize(normalize(vec3(-0.45, 0.55, 0.70)) + vec3(0, 0, 1))));
    float h8 = h * h * h * h * h * h * h * h;
    vec3 lamp = 0.66 * k * (0.35 + 0.65 * k) * vec3(1.0, 0.97, 0.93);
    vec3 sky = (0.015 + 0.0375 * (1.0 + n.y)) * vec3(0.88, 0.94, 1.0);
    return surface * (lamp + 0.22 * n.z * n.z + sky) * 1.15 + 0.07 * h8 * h8 * h8 * h8 * h8;
}

void main() {
    vec2 at = 2.0 * (gl_FragCoord.xy + corner + jitter) / size - 1.0;
    vec3 o = origin[0] + at.x * origin[1] + at.y * origin[2];
    vec3 d = direction[0] + at.x * direction[1] + at.y * direction[2];
    float t = 0.0, plane = -1e30;
    bool isGone = false;
    if (cut.xyz != vec3(0)) {
        float start = dot(cut.xyz, o) - cut.w, change = dot(cut.xyz, d);
        // Only what lies in front of the plane is kept; a ray that leaves it does not come back.
        if (start < 0.0) {
            plane = change > 0.0 ? -start / change : 1e30;
            isGone = change <= 0.0;
        } else if (change < 0.0) {
            plane = 1e30;
        }
        if (plane > 0.0 && plane < 1e30) t = plane;
    }
    Hit hit;
    bool isHit = !isGone && trace(o, d, t, hit);
    if (isHit && cut.xyz != vec3(0) && dot(cut.xyz, o + d * hit.t) < cut.w - 1e-3) isHit = false;
#ifdef NUMBERS
    vec3 n = normalize(normalToCamera * hit.normal);
    uint more = uint(hit.level) | hit.label << 8 | packSnorm2x16(vec2(0, n.z));
    found = isHit ? uvec4(hit.box + 1u, floatBitsToUint(hit.t), more, packSnorm2x16(n.xy)) : uvec4(0);
#else
    if (!isHit) {
        found = mix(background[0], background[1], 0.5 + 0.5 * at.y) * weight;
        return;
    }
    if (isSmooth && hit.level == 0 && hit.normal != vec3(0)) hit.normal = blended(o + d * hit.t, hit.normal);
    vec3 n = hit.normal == vec3(0) ? vec3(0, 0, 1) : normalize(normalToCamera * hit.normal);
    vec3 surface = surfaceColor;
#ifndef LABELS
    if (hasColors) {
        uint voxel = 3u * (hit.box - nodeCount);
        surface = linear(vec3(byteOf(colors, voxel), byteOf(colors, voxel + 1u), byteOf(colors, voxel + 2u)) / 255.0);
    }
#endif
    vec3 inside = vec3(0.50, 0.13, 0.09);
#ifdef LABELS
    if (hasColors) inside = surface = linear(vec3(texel(labelColors, hit.label).xyz) / 255.0);
#endif
    // Where a ray begins within matter, or comes to the surface from within, the plane has cut it open.
    bool isCap = hit.t <= plane || n.z < 0.0;
#ifdef LABELS
    if (isCells) isCap = hit.isWithin;
#endif
    isCap = isCap && plane > 0.0 && plane < 1e30;
    vec3 shown = isCap ? inside * (0.55 + 0.45 * abs(cutNormal.z)) : isFlat ? surface : lit(surface, n);
    found = vec4(encoded(clamp(shown, 0.0, 1.0)), 1.0) * weight;
#endif
}

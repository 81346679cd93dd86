// The same step by hand in C++, on the compiler's vectors: the speed of the processor without Python.
//
// Classical Runge-Kutta at 1 ms, double precision, strict (-ffp-contract=off), L vehicles at a time,
// kept in registers for all steps of a call. Blocks of L: 17 rows of state, 4 of commands.
// Its controller is a plain cascade without feed-forward, every fourth step.
#include <cmath>
#include <immintrin.h>

#ifdef __AVX512F__
constexpr int L = 8;
#else
constexpr int L = 4;
#endif
typedef double V __attribute__((vector_size(L * sizeof(double))));
#define INLINE static inline __attribute__((always_inline))

INLINE V all(double a) { return a - V{}; }
INLINE V root(V a) {
#ifdef __AVX512F__
    return (V)_mm512_sqrt_pd((__m512d)a);
#else
    V r;
    for (int i = 0; i < L; i++) r[i] = std::sqrt(a[i]);
    return r;
#endif
}

struct Body {
    double thrust, torque, lever, drag, im, g, gx, gy, gz, ix, iy, iz, half, decay, h;
};
struct Control {
    double kp, kv, ka, kr, fastest, tilt, mass, ix, iy, iz, most, per_lever, per_yaw, per_thrust;
    double x, y, z;
};
struct State { V px, py, pz, vx, vy, vz, qw, qx, qy, qz, wx, wy, wz; };
struct Rates { V ax, ay, az, dw, dx, dy, dz, bx, by, bz; };

INLINE Rates rates(const State& s, V m0, V m1, V m2, V m3, const Body& b) {
    V s0 = m0 * m0, s1 = m1 * m1, s2 = m2 * m2, s3 = m3 * m3, left = s0 + s1, right = s2 + s3;
    V lift = b.thrust * (left + right) * b.im;
    V k = b.drag * root(s.vx * s.vx + s.vy * s.vy + s.vz * s.vz);
    Rates r;
    r.ax = 2 * (s.qx * s.qz + s.qw * s.qy) * lift - k * s.vx;
    r.ay = 2 * (s.qy * s.qz - s.qw * s.qx) * lift - k * s.vy;
    r.az = (1 - 2 * (s.qx * s.qx + s.qy * s.qy)) * lift - k * s.vz - b.g;
    r.dw = 0.5 * (-s.qx * s.wx - s.qy * s.wy - s.qz * s.wz);
    r.dx = 0.5 * (s.qw * s.wx + s.qy * s.wz - s.qz * s.wy);
    r.dy = 0.5 * (s.qw * s.wy - s.qx * s.wz + s.qz * s.wx);
    r.dz = 0.5 * (s.qw * s.wz + s.qx * s.wy - s.qy * s.wx);
    r.bx = (b.lever * (left - right) - b.gx * s.wy * s.wz) * b.ix;
    r.by = (b.lever * ((s1 + s2) - (s0 + s3)) - b.gy * s.wx * s.wz) * b.iy;
    r.bz = (b.torque * ((s0 + s2) - (s1 + s3)) - b.gz * s.wx * s.wy) * b.iz;
    return r;
}

// The rates of position are the velocities of the state that the rates were taken at.
INLINE State moved(const State& s, const State& at, const Rates& r, double h) {
    return {s.px + h * at.vx, s.py + h * at.vy, s.pz + h * at.vz, s.vx + h * r.ax, s.vy + h * r.ay,
            s.vz + h * r.az, s.qw + h * r.dw, s.qx + h * r.dx, s.qy + h * r.dy, s.qz + h * r.dz,
            s.wx + h * r.bx, s.wy + h * r.by, s.wz + h * r.bz};
}

INLINE void step(State& s, V* m, const V* c, const Body& b) {
    V n[4], e[4];
    for (int i = 0; i < 4; i++) {
        n[i] = c[i] + (m[i] - c[i]) * b.half;
        e[i] = c[i] + (m[i] - c[i]) * b.decay;
    }
    Rates k1 = rates(s, m[0], m[1], m[2], m[3], b);
    State s2 = moved(s, s, k1, 0.5 * b.h);
    Rates k2 = rates(s2, n[0], n[1], n[2], n[3], b);
    State s3 = moved(s, s2, k2, 0.5 * b.h);
    Rates k3 = rates(s3, n[0], n[1], n[2], n[3], b);
    State s4 = moved(s, s3, k3, b.h);
    Rates k4 = rates(s4, e[0], e[1], e[2], e[3], b);
    double k = b.h / 6;
    s.px += k * ((s.vx + s4.vx) + 2 * (s2.vx + s3.vx));
    s.py += k * ((s.vy + s4.vy) + 2 * (s2.vy + s3.vy));
    s.pz += k * ((s.vz + s4.vz) + 2 * (s2.vz + s3.vz));
    s.vx += k * ((k1.ax + k4.ax) + 2 * (k2.ax + k3.ax));
    s.vy += k * ((k1.ay + k4.ay) + 2 * (k2.ay + k3.ay));
    s.vz += k * ((k1.az + k4.az) + 2 * (k2.az + k3.az));
    s.qw += k * ((k1.dw + k4.dw) + 2 * (k2.dw + k3.dw));
    s.qx += k * ((k1.dx + k4.dx) + 2 * (k2.dx + k3.dx));
    s.qy += k * ((k1.dy + k4.dy) + 2 * (k2.dy + k3.dy));
    s.qz += k * ((k1.dz + k4.dz) + 2 * (k2.dz + k3.dz));
    s.wx += k * ((k1.bx + k4.bx) + 2 * (k2.bx + k3.bx));
    s.wy += k * ((k1.by + k4.by) + 2 * (k2.by + k3.by));
    s.wz += k * ((k1.bz + k4.bz) + 2 * (k2.bz + k3.bz));
    V unit = 1 / root(s.qw * s.qw + s.qx * s.qx + s.qy * s.qy + s.qz * s.qz);
    s.qw *= unit; s.qx *= unit; s.qy *= unit; s.qz *= unit;
    V zero = all(0), free = s.pz < zero ? zero : all(1), least = s.pz < zero ? zero : s.vz;
    s.pz = s.pz > zero ? s.pz : zero;
    s.vx *= free; s.vy *= free; s.vz = s.vz > least ? s.vz : least;
    s.wx *= free; s.wy *= free; s.wz *= free;
    for (int i = 0; i < 4; i++) m[i] = e[i];
}

INLINE void control(const State& s, V* c, const Control& p, double g) {
    V vx = p.kp * (p.x - s.px), vy = p.kp * (p.y - s.py), vz = p.kp * (p.z - s.pz);
    V n = root(vx * vx + vy * vy + vz * vz + 1e-12);
    V k = n > all(p.fastest) ? p.fastest / n : all(1);
    V fx = p.kv * (vx * k - s.vx), fy = p.kv * (vy * k - s.vy), fz = p.kv * (vz * k - s.vz) + g;
    fz = fz < all(2) ? all(2) : fz;
    V h = root(fx * fx + fy * fy + 1e-12);
    k = h > fz * p.tilt ? fz * p.tilt / h : all(1);
    fx *= k; fy *= k;
    V f = 1 / root(fx * fx + fy * fy + fz * fz), zx = fx * f, zy = fy * f, zz = fz * f;
    V xx = 1 - 2 * (s.qy * s.qy + s.qz * s.qz), xy = 2 * (s.qx * s.qy + s.qw * s.qz);
    V xz = 2 * (s.qx * s.qz - s.qw * s.qy), yx = 2 * (s.qx * s.qy - s.qw * s.qz);
    V yy = 1 - 2 * (s.qx * s.qx + s.qz * s.qz), yz = 2 * (s.qy * s.qz + s.qw * s.qx);
    V bx = 2 * (s.qx * s.qz + s.qw * s.qy), by = 2 * (s.qy * s.qz - s.qw * s.qx);
    V bz = 1 - 2 * (s.qx * s.qx + s.qy * s.qy);
    V i = 1 / root(zy * zy + zz * zz), ly = zz * i, lz = -zy * i;
    V mx = ly * zz - lz * zy, my = lz * zx, mz = -ly * zx;
    V ex = 0.5 * ((zx * yx + zy * yy + zz * yz) - (by * ly + bz * lz));
    V ey = 0.5 * ((mx * bx + my * by + mz * bz) - (xx * zx + xy * zy + xz * zz));
    V ez = 0.5 * ((xy * ly + xz * lz) - (yx * mx + yy * my + yz * mz));
    V thrust = 0.25 * p.mass * (fx * bx + fy * by + fz * bz);
    V roll = p.per_lever * p.ix * p.kr * (-p.ka * ex - s.wx);
    V pitch = p.per_lever * p.iy * p.kr * (-p.ka * ey - s.wy);
    V yaw = p.per_yaw * p.iz * p.kr * (-p.ka * ez - s.wz);
    V wanted[4] = {thrust + roll - pitch + yaw, thrust + roll + pitch - yaw,
                   thrust - roll + pitch + yaw, thrust - roll - pitch - yaw};
    for (int j = 0; j < 4; j++) {
        V w = wanted[j] > all(0) ? wanted[j] : all(0);
        w = w < all(p.most) ? w : all(p.most);
        c[j] = root(w * p.per_thrust);
    }
}

template <bool CONTROLLED>
static void run(double* states, double* commands, long blocks, long steps, const Body& b,
                const Control& p) {
    for (long n = 0; n < blocks; n++) {
        V* x = (V*)states + n * 17;
        V* y = (V*)commands + n * 4;
        State s = {x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12]};
        V m[4] = {x[13], x[14], x[15], x[16]}, c[4] = {y[0], y[1], y[2], y[3]};
        for (long i = 0; i < steps; i++) {
            if (CONTROLLED && i % 4 == 0) control(s, c, p, b.g);
            step(s, m, c, b);
        }
        x[0] = s.px; x[1] = s.py; x[2] = s.pz; x[3] = s.vx; x[4] = s.vy; x[5] = s.vz;
        x[6] = s.qw; x[7] = s.qx; x[8] = s.qy; x[9] = s.qz; x[10] = s.wx; x[11] = s.wy;
        x[12] = s.wz; x[13] = m[0]; x[14] = m[1]; x[15] = m[2]; x[16] = m[3];
        y[0] = c[0]; y[1] = c[1]; y[2] = c[2]; y[3] = c[3];
    }
}

extern "C" {
int lanes() { return L; }
void dynamics(double* s, double* c, long blocks, long steps, const Body* b, const Control* p) {
    run<false>(s, c, blocks, steps, *b, *p);
}
void controlled(double* s, double* c, long blocks, long steps, const Body* b, const Control* p) {
    run<true>(s, c, blocks, steps, *b, *p);
}
// GFLOP/s of one core at its best: independent chains of fused multiply and add.
double multiply_add(long turns) {
    V x = all(1.0000001), y = all(1e-9), a[12], all_of_them = all(0);
#pragma GCC unroll 12
    for (int i = 0; i < 12; i++) a[i] = all(1.0 + i * 1e-3);
    for (long t = 0; t < turns; t++)
#pragma GCC unroll 12
        for (int i = 0; i < 12; i++) {
#ifdef __AVX512F__
            a[i] = (V)_mm512_fmadd_pd((__m512d)a[i], (__m512d)x, (__m512d)y);
#else
            a[i] = (V)_mm256_fmadd_pd((__m256d)a[i], (__m256d)x, (__m256d)y);
#endif
        }
#pragma GCC unroll 12
    for (int i = 0; i < 12; i++) all_of_them += a[i];
    return all_of_them[0] + all_of_them[L - 1];
}
}

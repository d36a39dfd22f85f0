/* What a hand-vectorised kernel reaches: the arithmetic of testbed/vision/kernel.py, a part's numbers in registers.

   Sixteen rays at a time with AVX-512, eight with AVX2. With -DFUSED products and sums are fused, which rounds
   otherwise than the project's kernel; without it the result is the same, bit for bit.
*/
#include <immintrin.h>
#include <math.h>
#include <stdint.h>

#define MOST 65536
enum { NONE, ALL, BOX, CAPSULE };

#ifdef __AVX512F__
#define LANES 16
typedef __m512 V;
typedef __mmask16 M;
#define OP(name) _mm512_##name
#define LESS_EQUAL(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define GREATER(a, b) _mm512_cmp_ps_mask(a, b, _CMP_GT_OQ)
#define BOTH(a, b) ((M)((a) & (b)))
#define BITS(a) (a)
#define ABS(a) _mm512_abs_ps(a)
#else
#define LANES 8
typedef __m256 V;
typedef __m256 M;
#define OP(name) _mm256_##name
#define LESS_EQUAL(a, b) _mm256_cmp_ps(a, b, _CMP_LE_OQ)
#define GREATER(a, b) _mm256_cmp_ps(a, b, _CMP_GT_OQ)
#define BOTH(a, b) _mm256_and_ps(a, b)
#define BITS(a) _mm256_movemask_ps(a)
#define ABS(a) _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a)
#endif

#define SET(a) OP(set1_ps)(a)
#define ADD(a, b) OP(add_ps)(a, b)
#define SUB(a, b) OP(sub_ps)(a, b)
#define MUL(a, b) OP(mul_ps)(a, b)
#ifdef FUSED
#define MUL_ADD(a, b, c) OP(fmadd_ps)(a, b, c)  /* a b + c */
#define MUL_SUB(a, b, c) OP(fmsub_ps)(a, b, c)  /* a b - c */
#define LESS_MUL(c, a, b) OP(fnmadd_ps)(a, b, c) /* c - a b */
#else
#define MUL_ADD(a, b, c) ADD(MUL(a, b), c)
#define MUL_SUB(a, b, c) SUB(MUL(a, b), c)
#define LESS_MUL(c, a, b) SUB(c, MUL(a, b))
#endif

typedef struct { int kind; float ux, uy, cx, cy, cz, square, half, hx, hy, middle, reach, px, py; } Part;

static Part prepare(const double *row, double eye) {
    Part p = {.kind = BOX, .ux = cos(row[4]), .uy = sin(row[4]), .cx = row[1] - eye, .cy = row[2], .cz = row[3]};
    if (row[0] == 0.0) {
        double front = fmax(row[3] - 0.5 * row[6], 0.0), back = row[3] + 0.5 * row[6];
        if (back <= 0.0) p.kind = NONE;
        p.middle = 0.5 * (front + back);
        p.reach = 0.5 * (back - front);
        p.hx = 0.5 * row[5];
        p.hy = 0.5 * row[7];
        p.px = p.cx * p.ux + p.cy * p.uy;
        p.py = p.cy * p.ux - p.cx * p.uy;
        return p;
    }
    float radius = row[5];
    p.square = radius * radius;
    p.half = row[0] == 2.0 ? 0.5 * row[6] : 0.0;
    float along = fminf(fmaxf(p.cx * p.ux + p.cy * p.uy, -p.half), p.half);
    float x = p.cx - along * p.ux, y = p.cy - along * p.uy;
    p.kind = x * x + y * y + p.cz * p.cz <= p.square ? ALL : CAPSULE;
    return p;
}

static inline M box(const Part *p, V dx, V dy) {
    V ux = SET(p->ux), uy = SET(p->uy), middle = SET(p->middle), reach = SET(p->reach);
    V hx = SET(p->hx), hy = SET(p->hy), px = SET(p->px), py = SET(p->py);
    V x = MUL_ADD(dx, ux, MUL(dy, uy)), y = MUL_SUB(dy, ux, MUL(dx, uy));
    V ex = ABS(x), ey = ABS(y);
    M a = LESS_EQUAL(ABS(MUL_SUB(middle, x, px)), MUL_ADD(reach, ex, hx));
    M b = LESS_EQUAL(ABS(MUL_SUB(middle, y, py)), MUL_ADD(reach, ey, hy));
    M c = LESS_EQUAL(ABS(MUL_SUB(x, py, MUL(y, px))), MUL_ADD(hx, ey, MUL(hy, ex)));
    return BOTH(BOTH(a, b), c);
}

static inline M capsule(const Part *p, V x, V y) {
    V ux = SET(p->ux), uy = SET(p->uy), cx = SET(p->cx), cy = SET(p->cy), cz = SET(p->cz), one = SET(1.0f);
    V ax = MUL_SUB(y, cz, cy), ay = LESS_MUL(cx, x, cz), az = MUL_SUB(x, cy, MUL(y, cx));
    V bz = MUL_SUB(x, uy, MUL(y, ux));
    V s = OP(div_ps)(LESS_MUL(MUL_SUB(ax, uy, MUL(ay, ux)), az, bz), MUL_ADD(bz, bz, one));
    s = OP(max_ps)(OP(min_ps)(s, SET(p->half)), SET(-p->half));
    ax = LESS_MUL(ax, s, uy);
    ay = MUL_ADD(s, ux, ay);
    az = MUL_ADD(s, bz, az);
    V away = MUL_ADD(az, az, MUL_ADD(ax, ax, MUL(ay, ay)));
    V ray = ADD(MUL_ADD(x, x, MUL(y, y)), one);
    M near = LESS_EQUAL(away, MUL(SET(p->square), ray));
    V ahead = ADD(MUL_ADD(x, MUL_ADD(s, ux, cx), MUL(y, MUL_ADD(s, uy, cy))), cz);
    return BOTH(near, GREATER(ahead, SET(0.0f)));
}

static inline void shade(uint8_t *out, unsigned dark, int grey, int white) {
#ifdef __AVX512F__
    _mm_storeu_si128((__m128i *)out, _mm_mask_blend_epi8(dark, _mm_set1_epi8(white), _mm_set1_epi8(grey)));
#else
    uint64_t ones = _pdep_u64(dark, 0x0101010101010101ull);
    uint64_t shades = 0x0101010101010101ull * (uint64_t)white - ones * (uint64_t)(white - grey);
    __builtin_memcpy(out, &shades, 8);
#endif
}

/* One bit a ray: those that meet a part are added. The part's numbers stay in registers. */
static void add(const Part *part, const float *dx, const float *dy, int blocks, uint16_t *dark) {
    Part p = *part;
    if (p.kind == BOX)
        for (int i = 0; i < blocks; i++)
            dark[i] |= BITS(box(&p, OP(loadu_ps)(dx + i * LANES), OP(loadu_ps)(dy + i * LANES)));
    else if (p.kind == CAPSULE)
        for (int i = 0; i < blocks; i++)
            dark[i] |= BITS(capsule(&p, OP(loadu_ps)(dx + i * LANES), OP(loadu_ps)(dy + i * LANES)));
    else if (p.kind == ALL)
        for (int i = 0; i < blocks; i++) dark[i] = 0xffff;
}

/* models (count, parts, 8), rays (n,) with LANES more to read, n at most MOST, out (count, n) */
void look(const double *models, int count, int parts, double eye, const float *dx, const float *dy, int n, int grey,
          int white, uint8_t *out) {
    uint16_t dark[MOST / LANES + 1];
    int whole = n / LANES, blocks = whole + 1;
    for (int m = 0; m < count; m++, out += n) {
        for (int i = 0; i < blocks; i++) dark[i] = 0;
        for (int k = 0; k < parts; k++) {
            Part part = prepare(models + (m * parts + k) * 8, eye);
            add(&part, dx, dy, blocks, dark);
        }
        for (int i = 0; i < whole; i++) shade(out + i * LANES, dark[i], grey, white);
        for (int i = whole * LANES; i < n; i++) out[i] = dark[whole] >> (i - whole * LANES) & 1 ? grey : white;
    }
}

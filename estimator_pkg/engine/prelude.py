# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What C lacks of Python's arithmetic, and the names that C and C++ take."""

HELPERS = {  # each is in the C text only where it is called
    'ZERO': """\
#ifdef __cplusplus
#define ZERO {}
#else
#define ZERO {0}
#endif""",
    'Complex': """\
typedef struct {
    double real, imag;
} Complex;""",
    'complex_of': """\
static inline Complex complex_of(double real, double imag)
{
    Complex made;
    made.real = real;
    made.imag = imag;
    return made;
}""",
    'complex_add': """\
static inline Complex complex_add(Complex a, Complex b)
{
    return complex_of(a.real + b.real, a.imag + b.imag);
}""",
    'complex_subtract': """\
static inline Complex complex_subtract(Complex a, Complex b)
{
    return complex_of(a.real - b.real, a.imag - b.imag);
}""",
    'complex_multiply': """\
static inline Complex complex_multiply(Complex a, Complex b)
{
    return complex_of(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real);
}""",
    'complex_equal': """\
static inline bool complex_equal(Complex a, Complex b)
{
    return a.real == b.real && a.imag == b.imag;
}""",
    'complex_abs': """\
/* As Python's abs, whose last bit differs from that of math.hypot. */
static inline double complex_abs(Complex a) { return hypot(a.real, a.imag); }""",
    'whole': """\
/* A whole number, of floor, ceil or rint: never -0.0. */
static inline double whole(double x) { return x + 0.0; }""",
    'to_int': """\
/* x towards zero; what does not fit is saturated, and NaN is the smallest. */
static inline int64_t to_int(double x)
{
    if (x >= -9223372036854775808.0 && x < 9223372036854775808.0) return (int64_t)x;
    return x > 0.0 ? INT64_MAX : INT64_MIN;
}""",
    'smaller': """\
/* The smaller one; a where b is NaN, or where they are 0.0 and -0.0. */
static inline double smaller(double a, double b) { return b < a ? b : a; }""",
    'larger': """\
/* The larger one; a where b is NaN, or where they are 0.0 and -0.0. */
static inline double larger(double a, double b) { return b > a ? b : a; }""",
    'smaller_int': """\
static inline int64_t smaller_int(int64_t a, int64_t b) { return b < a ? b : a; }""",
    'larger_int': """\
static inline int64_t larger_int(int64_t a, int64_t b) { return b > a ? b : a; }""",
    'abs_int': """\
static inline int64_t abs_int(int64_t n) { return n < 0 ? -n : n; }""",
    'floor_divide': """\
/* a / b, rounded down; 0 for a division by zero. */
static inline int64_t floor_divide(int64_t a, int64_t b)
{
    if (b == 0) return 0;
    if (b == -1) return a == INT64_MIN ? a : -a;
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}""",
    'modulo': """\
/* The rest of a / b, with the sign of b; 0 for a division by zero. */
static inline int64_t modulo(int64_t a, int64_t b)
{
    if (b == 0 || b == -1) return 0;
    const int64_t rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}""",
    'divide': """\
/* a / b, rounded once also where a or b has more digits than a double. */
static inline double divide(int64_t a, int64_t b)
{
    const uint64_t over = a < 0 ? 0 - (uint64_t)a : (uint64_t)a;
    const uint64_t under = b < 0 ? 0 - (uint64_t)b : (uint64_t)b;
    const uint64_t exact = (uint64_t)1 << 53;
    if (under == 0 || (over <= exact && under <= exact)) return (double)a / (double)b;
    uint64_t quotient = over / under, rest = over % under;
    int exponent = 0;
    while (over != 0 && quotient < 2 * exact) {
        rest *= 2;
        quotient = 2 * quotient + (rest >= under);
        rest -= rest >= under ? under : 0;
        exponent--;
    }
    const double size = ldexp((double)(quotient | (rest != 0)), exponent);
    return (a < 0) != (b < 0) ? -size : size;
}""",
}

# Functions of floats that C and Python share.
TESTS = ('isfinite', 'isnan', 'isinf')
ONE = 'sqrt exp log log10 log1p expm1 sin cos tan asin acos atan sinh cosh tanh erf erfc fabs'
MATH = dict.fromkeys((*ONE.split(), 'floor', 'ceil', *TESTS), 1)
MATH |= dict.fromkeys(('atan2', 'copysign', 'fmod', 'pow'), 2)

WORDS = """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t char32_t
    char8_t class co_await co_return co_yield compl concept const const_cast consteval constexpr
    constinit continue decltype default delete do double dynamic_cast else enum explicit export
    extern false float for friend goto if inline int int32_t int64_t int8_t linux long mutable
    namespace new noexcept not not_eq nullptr operator or or_eq private protected public register
    reinterpret_cast requires restrict return short signed sizeof static static_assert static_cast
    struct switch template this thread_local throw true try typedef typeid typename uint64_t uint8_t
    union unix unsigned using virtual void volatile wchar_t while xor xor_eq
    I INFINITY NAN INT64_MAX INT64_MIN NULL EOF hypot ldexp rint
"""
LIBRARY = """
    abs acosh asinh atanh cbrt div drem exit exp10 exp2 fdim finite fma fmax fmin frexp gamma
    ilogb index isgreater isinff isless isnormal isunordered j0 j1 jn labs ldiv lgamma llabs llrint
    llround log2 logb lrint lround memchr memcmp memcpy memmove modf nan nearbyint nextafter
    nexttoward pow10 random remainder remquo rindex round roundeven scalb scalbln scalbn select
    signbit significand signgam sincos stpcpy system tgamma time trunc y0 y1 yn
    DOMAIN HUGE HUGE_VAL OVERFLOW PLOSS SING TLOSS UNDERFLOW
"""
KEYWORDS = {
    *HELPERS,
    *MATH,
    *WORDS.split(),
}  # that no local and no field may have, in C99 and C++17
TAKEN = {*KEYWORDS, *LIBRARY.split()}  # that nothing may have that a file declares

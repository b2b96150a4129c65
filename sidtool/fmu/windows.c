/* What kernels call that the C library of Windows does not have. */
#include <math.h>

/* An extension of glibc: LLVM makes it of a sine and a cosine of one angle. The volatile
   copies keep the compiler from making the same call of what stands here. */
void sincos(double angle, double *sine, double *cosine)
{
    volatile double first = angle, second = angle;
    *sine = sin(first);
    *cosine = cos(second);
}

/* LU factors of large blocks, in place of LAPACK: kernels call it through pointers.
 *
 * A is stored by columns, all arguments are addresses as in LAPACK. `getrf` computes
 * A = P L U with partial pivoting, `getrs` solves A^T x = b, which is all that kernels
 * ask for: U^T y = b, L^T w = y, x = P w.
 */
#include <complex.h>
#include <math.h>
#include <stdint.h>

static double size_real(double x)
{
    return fabs(x);
}

static double size_complex(double complex x)
{
    return fabs(creal(x)) + fabs(cimag(x));
}

#define DEFINE_LU(NUMBER, SIZE, FACTOR, SOLVE)                                           \
    void FACTOR(const int *rows, const int *columns, NUMBER *A, const int *stride,       \
                int *pivots, int *info)                                                  \
    {                                                                                    \
        int n = *columns, ld = *stride;                                                  \
        (void)rows;                                                                      \
        *info = 0;                                                                       \
        for (int k = 0; k < n; k++) {                                                    \
            int largest = k;                                                             \
            for (int i = k + 1; i < n; i++)                                              \
                if (SIZE(A[i + k * ld]) > SIZE(A[largest + k * ld]))                     \
                    largest = i;                                                         \
            pivots[k] = largest + 1;                                                     \
            if (!(SIZE(A[largest + k * ld]) > 0.0)) {                                    \
                *info = *info ? *info : k + 1;                                           \
                continue;                                                                \
            }                                                                            \
            for (int j = 0; j < n && largest != k; j++) {                                \
                NUMBER entry = A[k + j * ld];                                            \
                A[k + j * ld] = A[largest + j * ld];                                     \
                A[largest + j * ld] = entry;                                             \
            }                                                                            \
            NUMBER inverse = 1.0 / A[k + k * ld];                                        \
            for (int i = k + 1; i < n; i++)                                              \
                A[i + k * ld] *= inverse;                                                \
            for (int j = k + 1; j < n; j++) {                                            \
                NUMBER factor = A[k + j * ld];                                           \
                for (int i = k + 1; i < n; i++)                                          \
                    A[i + j * ld] -= A[i + k * ld] * factor;                             \
            }                                                                            \
        }                                                                                \
    }                                                                                    \
                                                                                         \
    void SOLVE(const char *transposed, const int *order, const int *columns,             \
               const NUMBER *A, const int *stride, const int *pivots, NUMBER *b,         \
               const int *b_stride, int *info)                                           \
    {                                                                                    \
        int n = *order, ld = *stride;                                                    \
        (void)transposed;                                                                \
        *info = 0;                                                                       \
        for (int column = 0; column < *columns; column++) {                              \
            NUMBER *x = b + column * *b_stride;                                          \
            for (int i = 0; i < n; i++) {                                                \
                for (int j = 0; j < i; j++)                                              \
                    x[i] -= A[j + i * ld] * x[j];                                        \
                x[i] /= A[i + i * ld];                                                   \
            }                                                                            \
            for (int i = n - 1; i >= 0; i--)                                             \
                for (int j = i + 1; j < n; j++)                                          \
                    x[i] -= A[j + i * ld] * x[j];                                        \
            for (int i = n - 1; i >= 0; i--) {                                           \
                NUMBER entry = x[i];                                                     \
                x[i] = x[pivots[i] - 1];                                                 \
                x[pivots[i] - 1] = entry;                                                \
            }                                                                            \
        }                                                                                \
    }

DEFINE_LU(double, size_real, sidtool_dgetrf, sidtool_dgetrs)
DEFINE_LU(double complex, size_complex, sidtool_zgetrf, sidtool_zgetrs)

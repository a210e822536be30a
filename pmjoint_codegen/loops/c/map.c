#include "pmjoint_runtime.h"

/* One kernel on the arrays that its arguments and results point to; 0 is success. */
int pmj_apply(const pmj_function *kernel)
{
    return kernel->call(kernel->arg, kernel->res, kernel->iw, kernel->w, 0);
}

/* One kernel over many rows. A stride of 0 gives the same argument to every row; 0 is success. */
int pmj_map(const pmj_function *kernel, long long rows, long long n_arg, const double **arg,
            const long long *arg_stride, long long n_res, double **res, const long long *res_stride)
{
    for (long long row = 0; row < rows; ++row) {
        for (long long i = 0; i < n_arg; ++i) {
            kernel->arg[i] = arg[i] + row * arg_stride[i];
        }
        for (long long i = 0; i < n_res; ++i) {
            kernel->res[i] = res[i] ? res[i] + row * res_stride[i] : 0;
        }
        const int failed = pmj_apply(kernel);
        if (failed) {
            return failed;
        }
    }
    return 0;
}

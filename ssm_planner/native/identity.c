/* What the library was made from, and whether the processor has AVX2. */

#include "native.h"

SSM_API const char *ssm_key(void);
SSM_API int ssm_has_avx2(void);

const char *ssm_key(void)
{
    return SSM_KEY;
}

int ssm_has_avx2(void)
{
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") != 0;
#else
    return 0;
#endif
}

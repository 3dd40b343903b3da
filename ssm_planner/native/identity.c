/* Functions by which native/library.py recognises an outdated library and chooses the fastest one.
 */

#include "native.h"

SSM_API const char *ssm_key(void);
SSM_API int ssm_has_avx2(void);

/* Return the key of the sources (64 hexadecimal digits), which CMakeLists.txt computes. */
const char *ssm_key(void)
{
    return SSM_KEY;
}

/* Return 1 if the processor has AVX2 vector instructions, otherwise 0. */
int ssm_has_avx2(void)
{
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") != 0;
#else
    return 0;
#endif
}

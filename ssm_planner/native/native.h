/* Macros of all C files: SSM_API exports a function, and ALWAYS_INLINE inlines one. */

#ifndef SSM_NATIVE_H
#define SSM_NATIVE_H

#define SSM_API __attribute__((visibility("default")))
#define ALWAYS_INLINE inline __attribute__((always_inline))

#endif

#define WEFT_KERNEL kHksBaseline
#include "descriptor/hks_kernel.inc"

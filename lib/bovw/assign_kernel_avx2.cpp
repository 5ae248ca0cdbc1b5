#define WEFT_KERNEL kAssignAvx2
#include "bovw/assign_kernel.inc"

/* The least that shows that the library is there. */
#include <kimberlite.h>
#include <stdio.h>

int main(void)
{
    kmb_repository *repository = NULL;
    kmb_status status = kmb_repository_open("absent.kmb", NULL, &repository);
    printf("kimberlite %s: %s\n", kmb_version(), kmb_last_error());
    return status != KMB_IO || kmb_abi_version() != KMB_ABI_VERSION;
}

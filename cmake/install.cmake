# What an outside project needs, under one prefix.
include(CMakePackageConfigHelpers)

set(KMB_PACKAGE_DIRECTORY "${CMAKE_INSTALL_LIBDIR}/cmake/kimberlite")
list(JOIN KMB_SYSTEM_LIBRARIES " " KMB_PKG_CONFIG_PRIVATE)

configure_package_config_file(cmake/kimberlite-config.cmake.in kimberlite-config.cmake
    INSTALL_DESTINATION "${KMB_PACKAGE_DIRECTORY}"
    PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(kimberlite-config-version.cmake COMPATIBILITY SameMinorVersion)
# The prefix as seen from the .pc file, so that the installed tree can be moved.
file(RELATIVE_PATH KMB_PREFIX_FROM_PACKAGE "/${CMAKE_INSTALL_LIBDIR}/pkgconfig" "/")
configure_file(cmake/kimberlite.pc.in kimberlite.pc @ONLY)
file(CREATE_LINK "${KMB_SONAME}" "${CMAKE_CURRENT_BINARY_DIR}/libkimberlite.so" SYMBOLIC)

install(PROGRAMS "${KMB_LOADED_FILE}" DESTINATION "${CMAKE_INSTALL_LIBDIR}")
install(FILES "${CMAKE_CURRENT_BINARY_DIR}/libkimberlite.so" "${KMB_STATIC_FILE}"
    DESTINATION "${CMAKE_INSTALL_LIBDIR}")
install(FILES include/kimberlite.h include/kimberlite.hpp DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}")
install(FILES "${CMAKE_CURRENT_BINARY_DIR}/kimberlite-config.cmake"
    "${CMAKE_CURRENT_BINARY_DIR}/kimberlite-config-version.cmake"
    DESTINATION "${KMB_PACKAGE_DIRECTORY}")
install(FILES "${CMAKE_CURRENT_BINARY_DIR}/kimberlite.pc" DESTINATION "${CMAKE_INSTALL_LIBDIR}/pkgconfig")

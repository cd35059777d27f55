# The two libraries, built by cargo, as kimberlite::kimberlite (shared) and kimberlite::static.
find_program(CARGO cargo HINTS "$ENV{HOME}/.cargo/bin" REQUIRED)

set(KMB_SHARED_FILE "${KMB_TARGET_DIRECTORY}/release/libkimberlite.so")
set(KMB_STATIC_FILE "${KMB_TARGET_DIRECTORY}/release/libkimberlite.a")
# Programs look for the library under its SONAME, so it stands in the build folder under that name.
set(KMB_SONAME "libkimberlite.so.0")
set(KMB_LOADED_FILE "${CMAKE_BINARY_DIR}/lib/${KMB_SONAME}")
# What the Rust standard library needs of the system.
set(KMB_SYSTEM_LIBRARIES -lgcc_s -lutil -lrt -lpthread -lm -ldl -lc)
set(KMB_INCLUDE_DIRECTORY "${CMAKE_CURRENT_SOURCE_DIR}/include")

add_custom_target(kimberlite_cargo ALL
    COMMAND "${CARGO}" build --release --no-default-features --lib
            --manifest-path "${CMAKE_CURRENT_SOURCE_DIR}/Cargo.toml"
            --target-dir "${KMB_TARGET_DIRECTORY}"
    COMMAND "${CMAKE_COMMAND}" -E copy_if_different "${KMB_SHARED_FILE}" "${KMB_LOADED_FILE}"
    BYPRODUCTS "${KMB_SHARED_FILE}" "${KMB_STATIC_FILE}" "${KMB_LOADED_FILE}"
    COMMENT "Building the library with cargo"
    USES_TERMINAL
    VERBATIM)

add_library(kimberlite_shared SHARED IMPORTED GLOBAL)
set_target_properties(kimberlite_shared PROPERTIES
    IMPORTED_LOCATION "${KMB_LOADED_FILE}"
    IMPORTED_SONAME "${KMB_SONAME}"
    INTERFACE_INCLUDE_DIRECTORIES "${KMB_INCLUDE_DIRECTORY}")
add_dependencies(kimberlite_shared kimberlite_cargo)
add_library(kimberlite::kimberlite ALIAS kimberlite_shared)

add_library(kimberlite_static STATIC IMPORTED GLOBAL)
set_target_properties(kimberlite_static PROPERTIES
    IMPORTED_LOCATION "${KMB_STATIC_FILE}"
    INTERFACE_INCLUDE_DIRECTORIES "${KMB_INCLUDE_DIRECTORY}"
    INTERFACE_LINK_LIBRARIES "${KMB_SYSTEM_LIBRARIES}")
add_dependencies(kimberlite_static kimberlite_cargo)
add_library(kimberlite::static ALIAS kimberlite_static)

# The libraries of the engine, gathered in `flockstep_dependencies`; the engine's own headers show none but Eigen.
add_library(flockstep_dependencies INTERFACE)

find_package(Eigen3 REQUIRED NO_MODULE) # small vectors, poses
find_package(TBB REQUIRED) # threads
find_package(nlohmann_json REQUIRED) # scene files
find_package(tinyobjloader REQUIRED) # meshes
target_link_libraries(flockstep_dependencies INTERFACE TBB::tbb nlohmann_json::nlohmann_json tinyobjloader::tinyobjloader)

# Rays. Embree 4 where there is one, else 3.13; engine/src/trace/embree.hpp is the one place that knows the difference.
find_package(embree 4 QUIET)
if(NOT embree_FOUND)
  find_package(embree 3.13 REQUIRED)
endif()
string(REGEX MATCH "^[0-9]+" embree_major "${embree_VERSION}")
target_compile_definitions(flockstep_dependencies INTERFACE FLOCKSTEP_EMBREE_MAJOR=${embree_major})
target_link_libraries(flockstep_dependencies INTERFACE embree)

# SIMD with run-time dispatch. Distributions ship pkg-config files; upstream's install has a CMake package too.
find_package(PkgConfig REQUIRED)
pkg_check_modules(HWY QUIET IMPORTED_TARGET libhwy)
if(HWY_FOUND)
  target_link_libraries(flockstep_dependencies INTERFACE PkgConfig::HWY)
else()
  find_package(hwy REQUIRED)
  target_link_libraries(flockstep_dependencies INTERFACE hwy::hwy)
endif()
# Arm's scalable vectors cannot be members of structs, as the kernels have them; such processors run the NEON kernels.
set(disabled_targets HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128)
if(FLOCKSTEP_SANITIZE) # a minute and a half a target: the sanitizers see one with vectors and the one without
  string(APPEND disabled_targets |HWY_SSSE3|HWY_SSE4|HWY_AVX3|HWY_AVX3_DL)
endif()
target_compile_definitions(flockstep_dependencies INTERFACE HWY_DISABLED_TARGETS=${disabled_targets})

# JPEG files of camera frames. Distributions' CMake package may name files of packages that are not installed.
if(PkgConfig_FOUND)
  pkg_check_modules(TURBOJPEG QUIET IMPORTED_TARGET libturbojpeg)
endif()
if(TURBOJPEG_FOUND)
  target_link_libraries(flockstep_dependencies INTERFACE PkgConfig::TURBOJPEG)
else()
  find_package(libjpeg-turbo REQUIRED)
  target_link_libraries(flockstep_dependencies INTERFACE libjpeg-turbo::turbojpeg)
endif()

# OpenGL and EGL, whose functions it finds at run time: neither is linked, and a machine without them has one camera backend less.
pkg_check_modules(EPOXY REQUIRED IMPORTED_TARGET epoxy)
target_link_libraries(flockstep_dependencies INTERFACE PkgConfig::EPOXY ${CMAKE_DL_LIBS})

# Convex distance: Bullet's GJK and EPA, which are templates in headers; nothing of Bullet is linked.
find_path(BULLET_INCLUDE_DIR BulletCollision/NarrowPhaseCollision/btGjkEpa3.h PATH_SUFFIXES bullet REQUIRED)
target_include_directories(flockstep_dependencies SYSTEM INTERFACE ${BULLET_INCLUDE_DIR})

# Only the benchmarks; each is optional where no benchmark asks for it.
if(FLOCKSTEP_BENCH)
  find_package(benchmark QUIET)
  if(EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/bench/convex_distance.cpp)
    find_package(fcl REQUIRED)
    find_package(ccd REQUIRED)
  endif()
endif()

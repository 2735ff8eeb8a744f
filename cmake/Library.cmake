# The engine and the client of its server as shared libraries, and the package that find_package(flockstep) finds:
# flockstep::flockstep, flockstep::client and flockstep::task.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# export_only(TARGET MAP): hides all symbols that a map does not name, where the linker takes maps.
function(export_only target map)
  set(file ${CMAKE_CURRENT_SOURCE_DIR}/${map})
  target_link_options(${target} PRIVATE $<$<PLATFORM_ID:Linux>:LINKER:--version-script=${file}>)
  set_property(TARGET ${target} APPEND PROPERTY LINK_DEPENDS ${file})
endfunction()

# Made of the objects of the static library. The Python module and the tests link that one, since they use internal symbols.
add_library(flockstep SHARED $<TARGET_OBJECTS:flockstep_engine> $<TARGET_OBJECTS:flockstep_setup>
                             $<TARGET_OBJECTS:flockstep_generators> $<TARGET_OBJECTS:flockstep_server>
                             $<TARGET_OBJECTS:flockstep_protocol>)
add_library(flockstep::flockstep ALIAS flockstep)
# No binary compatibility is promised between versions, so each has a name of its own.
set_target_properties(flockstep PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION}
                                           INSTALL_RPATH_USE_LINK_PATH ON)
target_compile_features(flockstep PUBLIC cxx_std_20)
target_compile_definitions(flockstep INTERFACE $<$<PLATFORM_ID:Windows>:FLOCKSTEP_IMPORTS>)
target_include_directories(flockstep PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/engine/include>
                                            $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/server/include>
                                            $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
target_link_libraries(flockstep PUBLIC Eigen3::Eigen PRIVATE flockstep_options flockstep_dependencies flockstep_network)
export_only(flockstep cmake/library.map)

# The client depends on nothing of the engine, and its header on no other library's.
file(GLOB client_sources CONFIGURE_DEPENDS server/src/client/*.cpp)
add_library(flockstep_client SHARED ${client_sources} ${generated}/client/operations.cpp $<TARGET_OBJECTS:flockstep_protocol>)
add_dependencies(flockstep_client flockstep_messages)
add_library(flockstep::client ALIAS flockstep_client)
set_target_properties(flockstep_client PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION} EXPORT_NAME client
                                                  INSTALL_RPATH_USE_LINK_PATH ON)
target_compile_features(flockstep_client PUBLIC cxx_std_20)
target_include_directories(flockstep_client PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/server/include>
                                                   $<BUILD_INTERFACE:${generated}>
                                                   $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/engine/include>
                                                   $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
                                            PRIVATE server/src)
target_link_libraries(flockstep_client PRIVATE flockstep_options flockstep_network)
export_only(flockstep_client cmake/client.map)

# install_package(COMPONENT DESTINATION INCLUDE SCENES): the files that find_package reads, into the folder DESTINATION, for headers
# and scenes in the other two folders.
function(install_package component destination include scenes)
  set(folder ${CMAKE_CURRENT_BINARY_DIR}/package/${component})
  configure_package_config_file(cmake/flockstepConfig.cmake.in ${folder}/flockstepConfig.cmake INSTALL_DESTINATION ${destination}
                                PATH_VARS include scenes)
  write_basic_package_version_file(${folder}/flockstepConfigVersion.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${folder}/flockstepConfig.cmake ${folder}/flockstepConfigVersion.cmake DESTINATION ${destination}
          COMPONENT ${component})
endfunction()

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/flockstep)
set(data ${CMAKE_INSTALL_DATADIR}/flockstep)
install(TARGETS flockstep EXPORT flockstepTargets COMPONENT library)
install(EXPORT flockstepTargets NAMESPACE flockstep:: DESTINATION ${package} COMPONENT library)
install(DIRECTORY engine/include/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT library)
install(FILES server/include/flockstep/server.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/flockstep COMPONENT library)
install(DIRECTORY scenes DESTINATION ${data} COMPONENT library PATTERN generators EXCLUDE)
install(FILES LICENSE THIRD_PARTY.md DESTINATION ${data} COMPONENT library)
install_package(library ${package} ${CMAKE_INSTALL_INCLUDEDIR} ${data}/scenes)

install(TARGETS flockstep_client EXPORT flockstepClientTargets COMPONENT client)
install(EXPORT flockstepClientTargets NAMESPACE flockstep:: DESTINATION ${package} COMPONENT client)
install(FILES server/include/flockstep/client.hpp ${generated}/flockstep/client_operations.hpp
              ${generated}/flockstep/client_results.hpp engine/include/flockstep/export.hpp
        DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/flockstep COMPONENT client)
install(FILES LICENSE THIRD_PARTY.md DESTINATION ${data} COMPONENT client)
install_package(client ${package} ${CMAKE_INSTALL_INCLUDEDIR} ${data}/scenes)

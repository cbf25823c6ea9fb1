# SPDX-License-Identifier: GPL-3.0-or-later
# Copies Embree and the TBB that it needs into the package, under sonames of our own: Blender carries an Embree 4 and a
# TBB of its own, and the dynamic loader takes two libraries of one soname for the same one, whatever their paths.
# Run as: cmake -DEMBREE=… -DPATCHELF=… -DDESTINATION=… -P bundle_embree.cmake

file(GET_RUNTIME_DEPENDENCIES LIBRARIES ${EMBREE} RESOLVED_DEPENDENCIES_VAR dependencies
  UNRESOLVED_DEPENDENCIES_VAR unresolved POST_EXCLUDE_REGEXES ".*" POST_INCLUDE_REGEXES "/libtbb\\.so\\.12$")
if(NOT dependencies)
  message(FATAL_ERROR "Embree (${EMBREE}) does not lead to a libtbb.so.12 (unresolved: ${unresolved}). Install libembree-dev and libtbb-dev.")
endif()
list(GET dependencies 0 TBB)

function(bundle library name private_soname)
  file(REAL_PATH ${library} original)
  file(COPY_FILE ${original} ${DESTINATION}/${name})
  file(CHMOD ${DESTINATION}/${name} PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
  execute_process(COMMAND ${PATCHELF} --set-soname ${private_soname} --set-rpath $ORIGIN ${ARGN} ${DESTINATION}/${name}
    COMMAND_ERROR_IS_FATAL ANY)
endfunction()

file(MAKE_DIRECTORY ${DESTINATION}/licenses)
bundle(${TBB} libskytree_tbb.so.12 libskytree_tbb.so.12)
bundle(${EMBREE} libembree3.so.3 libskytree_embree3.so.3 --replace-needed libtbb.so.12 libskytree_tbb.so.12)

# Both are under the Apache License 2.0, which asks that its text and their notices go along.
foreach(document
    /usr/share/doc/libembree3-3/copyright=embree.txt
    /usr/share/doc/libtbb12/copyright=tbb.txt
    /usr/share/common-licenses/Apache-2.0=Apache-2.0.txt)
  string(REPLACE "=" ";" document ${document})
  list(GET document 0 source)
  list(GET document 1 name)
  file(COPY_FILE ${source} ${DESTINATION}/licenses/${name})
endforeach()

# Prints the firmware's size and fails the build beyond half of the chip: 32,256 bytes of flash (without
# the boot loader) and 2,048 of RAM. The stack's high-water mark is measured in the tests.
execute_process(COMMAND ${AVR_SIZE} ${ELF} OUTPUT_VARIABLE SIZES COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCH "\n *([0-9]+)[ \t]+([0-9]+)[ \t]+([0-9]+)" ROW "${SIZES}")
if(NOT ROW)
  message(FATAL_ERROR "avr-size said nothing understandable about ${ELF}:\n${SIZES}")
endif()
math(EXPR FLASH "${CMAKE_MATCH_1} + ${CMAKE_MATCH_2}")
math(EXPR RAM "${CMAKE_MATCH_2} + ${CMAKE_MATCH_3}")
message("arduino-extruder.elf: ${FLASH} bytes of flash (at most 16128), ${RAM} of static RAM (at most 1024)")
if(FLASH GREATER 16128 OR RAM GREATER 1024)
  file(REMOVE ${ELF})
  message(FATAL_ERROR "The extruder firmware is beyond half of the chip.")
endif()

unit_test(clients test_address)
unit_test(clients test_retry)
unit_test(clients test_offset)
unit_test(clients test_message)

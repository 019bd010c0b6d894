unit_test(message test_message)
